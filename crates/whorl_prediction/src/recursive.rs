//! The filter for readings as they arrive, and what these say of parameters that began at some time.
//!
//! A plant goes ahead, which the caller moves with what the actuators did; the filter's state is how far the platform is from it. Readings of
//! gyro and wheel speeds correct it, means over a short time, which stand in its middle. The attitude is given. METHOD.md, "As readings arrive".

use whorl_dynamics::plant::{RATE, ROTATION};
use whorl_dynamics::{Gyrostat, Plant};
use whorl_math::lanes::{BLOCK, Constants, Lanes, MOST_STATES};
use whorl_recording::{Channel, Component};

use crate::gains::Gains;
use crate::laws::Push;
use crate::noise::{Disturbance, Layout};
use crate::perturbed::Difference;
use crate::rows::Readings;
use crate::settings::Settings;

/// A filter for readings as they arrive.
pub struct Recursive {
    layout: Layout,
    gains: Gains,
    readings: Readings,
    acts: Vec<Act>,
    /// Columns of the state itself (one), of the constants, and of all parameters since each start.
    columns: Vec<Vec<Block>>,
    /// What was gathered since each start.
    pub starts: Vec<Since>,
    pub(crate) constants: Constants,
    /// Parameters of which G is found.
    pairs: Vec<(usize, usize)>,
}

/// Places of the columns of the state itself and of the constants; those since starts are behind.
const OWN: usize = 0;
const CONSTANTS: usize = 1;

/// What [`BLOCK`] parameters add over half of a step to coordinates of the plant, and to innovations of the gyro.
struct Act {
    half: Lanes,
    gyro: Lanes,
    is_any: bool,
}

struct Block {
    /// Of the filter's state and of m, a row for each coordinate and each constant.
    of_state: Lanes,
    of_means: Lanes,
    /// Of the innovations of the present instant, a row each.
    d: Lanes,
    /// Any of them has done anything; else all is zero.
    is_active: bool,
}

/// What innovations have said of parameters since a start, with the platform's constants integrated out over their priors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Since {
    /// The start \[ns\].
    pub start_ns: i64,
    /// g, the slope of log p by each parameter at zero.
    pub slope: Vec<f64>,
    /// G, of the pairs that were asked for.
    pub information: Vec<f64>,
    /// Sums of |d'/sqrt(s)|.
    pub absolute: Vec<f64>,
}

/// A reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Of the gyro or of a wheel's speed.
    pub component: Component,
    /// Less what the plant's state predicts [rad/s].
    pub value: f64,
    /// Variance of its noise [(rad/s)^2].
    pub variance: f64,
}

impl Recursive {
    /// About a plant of a platform, with these random torques and so many parameters, the constants first; of those that began at a start
    /// information is gathered of these pairs. Of the motion nothing is uncertain yet: see [`Self::forget_motion`].
    pub fn new(
        gyrostat: &Gyrostat,
        plant: &Plant,
        disturbance: &Disturbance,
        (constants, parameters): (usize, usize),
        pairs: Vec<(usize, usize)>,
    ) -> Self {
        let (body, motors) = (disturbance.body.len(), disturbance.motors_n_m.len());
        let layout = Layout::new(plant.tangent(), body, motors, true, false);
        let covariance = Lanes::zeros(layout.size(), layout.size());
        let sensors = &gyrostat.model().sensors;
        let mut gains = Gains::of(Settings::default(), disturbance, layout, sensors, plant, covariance);
        let gyro = &sensors.gyro.errors;
        let bias = |axis: usize| gyro.bias_turn_on_stddev[axis].max(gyro.one_sample_stddev()[axis]);
        let biases = layout.gyro_bias().enumerate().map(|(axis, i)| (i, bias(axis)));
        for (i, stddev) in disturbance.coordinates(layout).map(|(i, stddev, _)| (i, stddev)).chain(biases) {
            gains.covariance.row_mut(i)[i] = stddev * stddev;
        }
        let zeros = |rows| Lanes::zeros(rows, BLOCK);
        let act = |_| Act { half: zeros(layout.plant.size()), gyro: zeros(3), is_any: false };
        let mut new = Self {
            layout,
            gains,
            readings: Readings::default(),
            acts: (0..parameters.div_ceil(BLOCK)).map(act).collect(),
            columns: Vec::new(),
            starts: Vec::new(),
            constants: Constants::new(constants),
            pairs,
        };
        new.columns = vec![new.blocks(1, constants), new.blocks(constants, 0)];
        new.columns[OWN].iter_mut().for_each(|block| block.is_active = true);
        new
    }

    /// Columns of so many parameters, which have done nothing yet, with rows for so many constants.
    fn blocks(&self, parameters: usize, constants: usize) -> Vec<Block> {
        let zeros = |rows| Lanes::zeros(rows, BLOCK);
        let (size, is_active) = (self.layout.size(), false);
        let block = |_| Block { of_state: zeros(size), of_means: zeros(constants), d: zeros(0), is_active };
        (0..parameters.div_ceil(BLOCK)).map(block).collect()
    }

    /// Nothing is known of the motion but that it is about the plant's, within these deviations of rate and wheel speeds [rad/s].
    pub fn forget_motion(&mut self, rate_rad_s: f64, speed_rad_s: f64) {
        let wheels = self.layout.plant.wheels().map(|i| (i, speed_rad_s));
        for (i, stddev) in RATE.map(|i| (i, rate_rad_s)).chain(wheels) {
            self.hold(i);
            self.gains.covariance.row_mut(i)[i] = stddev * stddev;
        }
    }

    /// Nothing is uncertain of a coordinate of the plant, and nothing moves it.
    fn hold(&mut self, i: usize) {
        self.gains.hold(i);
        self.columns.iter_mut().flatten().for_each(|block| block.of_state.hold_row(i));
    }

    /// All parameters begin at this time \[ns\]. Of starts the last few are followed.
    pub fn begin(&mut self, start_ns: i64, most: usize) {
        let parameters = self.acts.len() * BLOCK;
        let (slope, information) = (vec![0.0; parameters], vec![0.0; self.pairs.len()]);
        self.columns.push(self.blocks(parameters, self.constants.covariance.nrows()));
        self.starts.push(Since { start_ns, absolute: slope.clone(), slope, information });
        if self.starts.len() > most {
            self.columns.remove(CONSTANTS + 1);
            self.starts.remove(0);
        }
    }

    /// Follows a step that the plant has made \[ns\], takes in what was read in its middle, and moves the plant to where the platform is believed to be;
    /// false where the motion is lost. `does`: what each parameter does otherwise. `random`: impulses by which it may have been otherwise, one standard
    /// deviation each [N m s]. `wandered`: readings say something of constants and parameters as well, and so far back to their priors the constants may be.
    pub fn pass(
        &mut self,
        plant: &mut Plant,
        step_ns: i64,
        does: &[Difference],
        random: &[Push],
        readings: &[Reading],
        wandered: Option<f64>,
    ) -> bool {
        let half_ns = step_ns / 2;
        self.act(plant, does, half_ns as f64 * 1e-9);
        self.follow(plant, half_ns);
        self.add_random(plant, random);
        if !self.take_in(readings, wandered) {
            return false;
        }
        self.add_random(plant, random);
        self.follow(plant, step_ns - half_ns);
        let own = &mut self.columns[OWN][0].of_state;
        let change: Vec<f64> = (0..self.layout.plant.size()).map(|i| own.row(i)[0]).collect();
        plant.change_state(&change);
        (0..change.len()).for_each(|i| own.hold_row(i));
        true
    }

    /// What parameters do otherwise from now on, over steps of this length \[s\].
    fn act(&mut self, plant: &Plant, all: &[Difference], step_s: f64) {
        for act in &mut self.acts {
            act.half.clear(self.layout.plant.size());
            act.gyro.clear(3);
            act.is_any = false;
        }
        let half_s = 0.5 * step_s;
        for (parameter, does) in all.iter().enumerate().filter(|(_, of)| **of != Difference::default()) {
            let Act { half, gyro, is_any } = &mut self.acts[parameter / BLOCK];
            let column = parameter % BLOCK;
            *is_any = true;
            RATE.zip(&does.body_rad_s2).for_each(|(i, rate)| half.row_mut(i)[column] = rate * half_s);
            let wheels = plant.tangent().wheels().zip(does.wheels_rad_s2).zip(plant.held_wheels());
            for ((i, rate), _) in wheels.filter(|(_, held)| !held) {
                half.row_mut(i)[column] = rate * half_s;
            }
            (0..3).for_each(|axis| gyro.row_mut(axis)[column] = -does.gyro_rad_s[axis]);
        }
    }

    /// Follows a step that the plant has made: s <- F (s + h/2 r) + h/2 r.
    fn follow(&mut self, plant: &Plant, step_ns: i64) {
        self.gains.follow(plant, step_ns);
        let transition = &self.gains.step.transition;
        for (g, blocks) in self.columns.iter_mut().enumerate() {
            for (block, act) in blocks.iter_mut().zip(&self.acts) {
                let half = Some(&act.half).filter(|_| act.is_any && g != OWN);
                block.is_active |= half.is_some();
                if block.is_active {
                    half.into_iter().for_each(|half| _ = block.of_state.add(half));
                    block.of_state.carry(transition);
                    half.into_iter().for_each(|half| _ = block.of_state.add(half));
                }
            }
        }
        let wheels = plant.tangent().wheels().zip(plant.held_wheels()).filter(|(_, held)| *held);
        ROTATION.chain(wheels.map(|(i, _)| i)).for_each(|i| self.hold(i));
    }

    /// Adds half of what is random in a step, that of one side of its middle.
    fn add_random(&mut self, plant: &Plant, random: &[Push]) {
        for push in random {
            let mut change = [0.0; MOST_STATES];
            push.add_rates(plant, &self.gains.linearised, 0.5_f64.sqrt(), &mut |i, x| change[i] += x);
            for (i, x) in change.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                let row = self.gains.covariance.row_mut(i);
                row.iter_mut().zip(&change).for_each(|(sum, y)| *sum += x * y);
            }
        }
    }

    /// Corrects the state by readings of one instant; false where the covariance is none any more.
    fn take_in(&mut self, readings: &[Reading], wandered: Option<f64>) -> bool {
        let rows = &mut self.readings;
        rows.clear();
        for Reading { component, variance, .. } in readings {
            let index = component.index();
            if component.channel == Channel::Gyro {
                let row = self.gains.linearised.imu_by_state.row(index);
                row.iter().enumerate().for_each(|(i, x)| rows.by_state.set(i, *x));
                rows.by_state.set(self.layout.gyro_bias().start + index, 1.0);
            } else {
                rows.by_state.set(self.layout.plant.wheels().start + index, 1.0);
            }
            rows.by_state.end_row();
            rows.variances.push(*variance);
        }
        if !self.gains.correct(rows) {
            return false;
        }
        for (g, blocks) in self.columns.iter_mut().enumerate() {
            for (block, act) in blocks.iter_mut().zip(&self.acts).filter(|(block, _)| block.is_active) {
                block.d.clear(readings.len());
                for (r, Reading { component, value, .. }) in readings.iter().enumerate() {
                    if g == OWN {
                        block.d.row_mut(r)[0] = *value;
                    } else if component.channel == Channel::Gyro {
                        block.d.row_mut(r).copy_from_slice(act.gyro.row(component.index()));
                    }
                }
                block.of_state.take_in(&rows.by_state, &self.gains.gain, &mut block.d);
                self.gains.gain.normalise(&mut block.d);
            }
        }
        if let Some(share) = wandered {
            self.gather(readings.len(), share);
        }
        self.innovations().all(f64::is_finite)
    }

    /// Takes the constants out of so many innovations, and adds what these say of what began at each start.
    fn gather(&mut self, readings: usize, wandered: f64) {
        let count = self.constants.covariance.nrows();
        let of_constants = &self.columns[CONSTANTS];
        self.constants.take_in(wandered, readings, |r, row| {
            for (b, block) in of_constants.iter().enumerate().filter(|(_, block)| block.is_active) {
                let d = (b * BLOCK..count).zip(block.d.row(r));
                d.for_each(|(k, x)| row.set(k, *x));
            }
        });
        let all = self.columns.iter_mut().enumerate().filter(|(g, _)| *g != CONSTANTS);
        for block in all.flat_map(|(_, blocks)| blocks).filter(|block| block.is_active) {
            self.constants.take_out(&mut block.of_means, &mut block.d);
        }
        let own = &self.columns[OWN][0].d;
        for (blocks, since) in self.columns[CONSTANTS + 1..].iter().zip(&mut self.starts) {
            let mut d = vec![0.0; blocks.len() * BLOCK];
            for r in 0..readings {
                let active = blocks.iter().zip(d.chunks_mut(BLOCK)).filter(|(block, _)| block.is_active);
                active.for_each(|(block, to)| to.copy_from_slice(block.d.row(r)));
                let e = own.row(r)[0];
                since.slope.iter_mut().zip(&d).for_each(|(sum, d)| *sum -= e * d);
                since.absolute.iter_mut().zip(&d).for_each(|(sum, d)| *sum += d.abs());
                let products = self.pairs.iter().map(|(a, b)| d[*a] * d[*b]);
                since.information.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
            }
        }
    }

    /// Of the last readings: their innovations over their deviations, without what is known of the constants.
    pub fn innovations(&self) -> impl Iterator<Item = f64> {
        let d = &self.columns[OWN][0].d;
        (0..d.rows()).map(|r| d.row(r)[0])
    }
}
