//! The filter for readings as they arrive, and what these say of parameters that began at some time.
//!
//! A plant goes ahead, which the caller moves with what the actuators did; the filter's state is how far the platform is from it. Readings of
//! gyro and wheel speeds correct it, also such as are means over a short time: they then stand in its middle. The attitude is given.
//!
//! The first parameters are constants of the platform, b ~ N(0, 1) in their units. They are estimated beside the state, which nothing changes:
//! B. Friedland, "Treatment of bias in recursive filtering", *IEEE Trans. Automatic Control* 14 (1969) 359. With innovations e over
//! their deviations, and how these change with the constants, D, and with parameters that began at some start, d:
//!
//! ```text
//! s = 1 + D P D^T        k = P D^T/s        e' = e - D m        d' = d - D M
//! P <- P - k D P         m <- m + k e'      M <- M + k d'       G += d' d'^T/s        g -= d' e'/s
//! ```
//!
//! m is minus the mean of b. So e'/sqrt(s) is white with unit variance whatever the constants are, of mean -(d'/sqrt(s)) phi if parameters
//! phi began at the start. What is done to m is what is done to M, as to the state what is done to its sensitivities: each is a column.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, RATE, ROTATION};
use whorl_dynamics::{Gyrostat, Plant};
use whorl_math::lanes::{BLOCK, Gain, Lanes, MOST_STATES, Sparse, dot};
use whorl_recording::{Channel, Component};

use crate::gains::Gains;
use crate::laws::add_rates_by_torque;
use crate::noise::{Disturbance, Layout};
use crate::perturbed::Difference;
use crate::rows::Readings;
use crate::settings::Settings;

/// A filter for readings as they arrive.
pub struct Recursive {
    layout: Layout,
    gains: Gains<'static>,
    readings: Readings,
    /// What parameters do now.
    pushes: Vec<Push>,
    /// Columns of the state itself (one), of the constants, and of all parameters since each start, and what was gathered since these.
    columns: Vec<Vec<Block>>,
    starts: Vec<Since>,
    /// P, and of the present instant D and k.
    covariance: DMatrix<f64>,
    by_constants: Sparse,
    gain: Gain,
    /// Parameters of which G is found.
    pairs: Vec<(usize, usize)>,
}

/// Places of the columns of the state itself and of the constants; those since starts are behind.
const OWN: usize = 0;
const CONSTANTS: usize = 1;

/// What [`BLOCK`] parameters add over half of a step to coordinates of the plant, and to innovations of the gyro.
struct Push {
    half: Lanes,
    gyro: Lanes,
    is_any: bool,
}

/// Columns of as many parameters.
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
    #[must_use]
    pub fn new(
        gyrostat: &Gyrostat,
        plant: &Plant,
        disturbance: &Disturbance,
        (constants, parameters): (usize, usize),
        pairs: Vec<(usize, usize)>,
    ) -> Self {
        let processes = disturbance.processes().count();
        let layout = Layout::new(plant.tangent(), processes, disturbance.motors(), true, false);
        let mut hidden_noise = vec![0.0; gyrostat.effects().hidden_states()];
        gyrostat.effects().hidden_noise(&mut hidden_noise);
        let walks = layout.walks(&gyrostat.model().sensors, &hidden_noise);
        let mut linearised = LinearisedPlant::none(plant);
        plant.linearise_into(&mut linearised, true);
        let covariance = Lanes::zeros(layout.size(), layout.size());
        let of = Cow::Owned(disturbance.clone());
        let mut gains = Gains::of(Settings::default(), of, layout, walks, &[], covariance, linearised, plant);
        let gyro = &gyrostat.model().sensors.gyro.errors;
        let bias = |axis: usize| gyro.bias_turn_on_stddev[axis].max(gyro.one_sample_stddev()[axis]);
        let biases = layout.gyro_bias().enumerate().map(|(axis, i)| (i, bias(axis)));
        for (i, stddev) in disturbance.coordinates(layout).map(|(i, stddev, _)| (i, stddev)).chain(biases) {
            gains.covariance.row_mut(i)[i] = stddev * stddev;
        }
        let zeros = |rows| Lanes::zeros(rows, BLOCK);
        let push = || Push { half: zeros(layout.plant.size()), gyro: zeros(3), is_any: false };
        let mut own = blocks(1, layout.size(), constants);
        own.iter_mut().for_each(|block| block.is_active = true);
        Self {
            layout,
            gains,
            readings: Readings::default(),
            pushes: (0..parameters.div_ceil(BLOCK)).map(|_| push()).collect(),
            columns: vec![own, blocks(constants, layout.size(), 0)],
            starts: Vec::new(),
            covariance: DMatrix::identity(constants, constants),
            by_constants: Sparse::default(),
            gain: Gain::default(),
            pairs,
        }
    }

    /// Nothing is known of the motion but that it is about the plant's: standard deviations of each component of the rate and of each wheel's speed
    /// [rad/s].
    pub fn forget_motion(&mut self, rate_rad_s: f64, speed_rad_s: f64) {
        let wheels = self.layout.plant.wheels().map(|i| (i, speed_rad_s));
        for (i, stddev) in RATE.map(|i| (i, rate_rad_s)).chain(wheels) {
            self.gains.hold(i);
            self.columns.iter_mut().flatten().for_each(|block| block.of_state.hold_row(i));
            self.gains.covariance.row_mut(i)[i] = stddev * stddev;
        }
    }

    /// All parameters begin at this time \[ns\]. Of starts the last few are followed.
    pub fn begin(&mut self, start_ns: i64, most: usize) {
        let (constants, parameters) = (self.covariance.nrows(), self.pushes.len() * BLOCK);
        let (slope, information) = (vec![0.0; parameters], vec![0.0; self.pairs.len()]);
        self.columns.push(blocks(parameters, self.layout.size(), constants));
        self.starts.push(Since { start_ns, absolute: slope.clone(), slope, information });
        if self.starts.len() > most {
            self.columns.remove(CONSTANTS + 1);
            self.starts.remove(0);
        }
    }

    /// Follows no start, and knows nothing of the constants but their priors.
    pub fn forget_parameters(&mut self) {
        let constants = self.covariance.nrows();
        self.starts.clear();
        self.columns.truncate(CONSTANTS);
        self.columns.push(blocks(constants, self.layout.size(), 0));
        self.columns[OWN].iter_mut().for_each(|block| block.of_means.clear(constants));
        self.covariance.fill_with_identity();
    }

    /// What was gathered since each start.
    #[must_use]
    pub fn starts(&self) -> &[Since] {
        &self.starts
    }

    /// How the coordinates of the plant move by torques on the body, body axes, and on wheels, of which the body takes the opposite
    /// [unit/s per N m].
    #[must_use]
    pub fn rates_by_torque(&self, plant: &Plant, body: Vector3<f64>, wheels: &[f64]) -> [f64; MOST_STATES] {
        let mut rates = [0.0; MOST_STATES];
        add_rates_by_torque(plant, &self.gains.linearised, body, wheels, &mut |i, rate| rates[i] += rate);
        rates
    }

    /// The plant may have moved otherwise by this or by the opposite, one standard deviation, independently of all else.
    pub fn add_random(&mut self, change: &[f64]) {
        let covariance = &mut self.gains.covariance;
        for (i, x) in change.iter().enumerate().take(self.layout.plant.size()).filter(|(_, x)| **x != 0.0) {
            covariance.row_mut(i).iter_mut().zip(change).for_each(|(sum, y)| *sum += x * y);
        }
    }

    /// What parameters do otherwise from now on, in their order, over steps of this length \[s\].
    pub fn push(&mut self, plant: &Plant, all: impl Iterator<Item = Difference>, step_s: f64) {
        for push in self.pushes.iter_mut().filter(|push| push.is_any) {
            push.half.clear(self.layout.plant.size());
            push.gyro.clear(3);
            push.is_any = false;
        }
        let half_s = 0.5 * step_s;
        for (parameter, does) in all.enumerate() {
            let Push { half, gyro, is_any } = &mut self.pushes[parameter / BLOCK];
            let column = parameter % BLOCK;
            let mut add = |i: usize, rate: f64| half.row_mut(i)[column] += rate;
            *is_any |= does != Difference::None;
            match does {
                Difference::None => {}
                Difference::Acceleration(body, wheels) => {
                    RATE.zip(&body).for_each(|(i, rate)| add(i, rate * half_s));
                    let turning = plant.held_wheels().zip(wheels).zip(plant.tangent().wheels());
                    turning.filter(|((held, _), _)| !held).for_each(|((_, rate), i)| add(i, rate * half_s));
                }
                Difference::Gyro(more) => (0..3).for_each(|axis| gyro.row_mut(axis)[column] -= more[axis]),
            }
        }
    }

    /// Follows a step that the plant has made.
    pub fn follow(&mut self, plant: &Plant, step_ns: i64) {
        self.gains.follow(plant, step_ns);
        let held = plant.tangent().wheels().zip(plant.held_wheels()).filter(|(_, held)| *held);
        let held: Vec<usize> = ROTATION.chain(held.map(|(i, _)| i)).collect();
        held.iter().for_each(|i| self.gains.hold(*i));
        let transition = &self.gains.step.transition;
        for (g, blocks) in self.columns.iter_mut().enumerate() {
            for (block, push) in blocks.iter_mut().zip(&self.pushes) {
                block.carry(transition, Some(push).filter(|push| push.is_any && g != OWN), &held);
            }
        }
    }

    /// Corrects the state by readings of one instant; false where the covariance is none any more. They also say something of
    /// constants and parameters if it is told what share of the way back to their priors the constants may have wandered since those before.
    pub fn take_in(&mut self, readings: &[Reading], wandered: Option<f64>) -> bool {
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
        let gain = &self.gains.gain;
        for (g, blocks) in self.columns.iter_mut().enumerate() {
            for (block, push) in blocks.iter_mut().zip(&self.pushes).filter(|(block, _)| block.is_active) {
                block.d.clear(readings.len());
                for (r, Reading { component, value, .. }) in readings.iter().enumerate() {
                    if g == OWN {
                        block.d.row_mut(r)[0] = *value;
                    } else if component.channel == Channel::Gyro {
                        block.d.row_mut(r).copy_from_slice(push.gyro.row(component.index()));
                    }
                }
                block.of_state.take_in(&rows.by_state, gain, &mut block.d);
                block.normalise(gain);
            }
        }
        if let Some(share) = wandered {
            self.gather(readings.len(), share);
        }
        self.innovations().all(f64::is_finite)
    }

    /// Takes the constants out of so many innovations, and adds what these say of what began at each start.
    fn gather(&mut self, readings: usize, wandered: f64) {
        let count = self.covariance.nrows();
        for i in 0..count {
            self.covariance[(i, i)] += wandered * (1.0 - self.covariance[(i, i)]);
        }
        self.by_constants.clear();
        self.gain.clear(count);
        let mut across = DVector::zeros(count);
        for r in 0..readings {
            for (b, block) in self.columns[CONSTANTS].iter().enumerate().filter(|(_, block)| block.is_active)
            {
                let d = block.d.row(r).iter().enumerate().take(count - b * BLOCK);
                d.for_each(|(k, x)| self.by_constants.set(b * BLOCK + k, *x));
            }
            self.by_constants.end_row();
            let row = self.by_constants.row(r);
            across.fill(0.0);
            row.iter().for_each(|(k, x)| across.axpy(*x, &self.covariance.column(*k), 1.0));
            let variance = 1.0 + dot(row, across.as_slice());
            for (k, x) in across.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                self.covariance.column_mut(k).axpy(-x / variance, &across, 1.0);
            }
            self.gain.push(across.iter().map(|x| x / variance), row, variance);
        }
        let all = self.columns.iter_mut().enumerate().filter(|(g, _)| *g != CONSTANTS);
        for block in all.flat_map(|(_, blocks)| blocks).filter(|block| block.is_active) {
            block.of_means.take_in(&self.by_constants, &self.gain, &mut block.d);
            block.normalise(&self.gain);
        }
        for (blocks, since) in self.columns[CONSTANTS + 1..].iter().zip(&mut self.starts) {
            let mut d = vec![0.0; blocks.len() * BLOCK];
            for r in 0..readings {
                let active = blocks.iter().zip(d.chunks_mut(BLOCK)).filter(|(block, _)| block.is_active);
                active.for_each(|(block, to)| to.copy_from_slice(block.d.row(r)));
                let e = self.columns[OWN][0].d.row(r)[0];
                since.slope.iter_mut().zip(&d).for_each(|(sum, d)| *sum -= e * d);
                since.absolute.iter_mut().zip(&d).for_each(|(sum, d)| *sum += d.abs());
                let products = self.pairs.iter().map(|(a, b)| d[*a] * d[*b]);
                since.information.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
            }
        }
    }

    /// Of the readings that were taken in last: their innovations over their deviations, without what is known of the constants if they were
    /// gathered.
    pub fn innovations(&self) -> impl Iterator<Item = f64> {
        let d = &self.columns[OWN][0].d;
        (0..d.rows()).map(|r| d.row(r)[0])
    }

    /// Moves the plant to where the platform is believed to be.
    pub fn move_plant(&mut self, plant: &mut Plant) {
        let own = &mut self.columns[OWN][0].of_state;
        let change: Vec<f64> = (0..self.layout.plant.size()).map(|i| own.row(i)[0]).collect();
        plant.change_state(&change);
        (0..change.len()).for_each(|i| own.hold_row(i));
    }
}

/// Of so many parameters that begin, of a filter with so many coordinates of its state and constants.
fn blocks(parameters: usize, size: usize, constants: usize) -> Vec<Block> {
    let zeros = |rows: usize| Lanes::zeros(rows, BLOCK);
    let block = || Block { of_state: zeros(size), of_means: zeros(constants), d: zeros(0), is_active: false };
    (0..parameters.div_ceil(BLOCK)).map(|_| block()).collect()
}

impl Block {
    /// Follows a step, s <- F (s + h/2 r) + h/2 r, at the end of which nothing moves these coordinates.
    fn carry(&mut self, transition: &Sparse, push: Option<&Push>, held: &[usize]) {
        if let Some(push) = push {
            self.is_active = true;
            self.of_state.add(&push.half);
        }
        if self.is_active {
            self.of_state.carry(transition);
            push.into_iter().for_each(|push| _ = self.of_state.add(&push.half));
            held.iter().for_each(|i| self.of_state.hold_row(*i));
        }
    }

    /// Innovations over their deviations.
    fn normalise(&mut self, gain: &Gain) {
        for (r, variance) in gain.variances.iter().enumerate() {
            let deviation = variance.sqrt();
            self.d.row_mut(r).iter_mut().for_each(|d| *d /= deviation);
        }
    }
}

#[cfg(test)]
mod tests {
    use whorl_dynamics::{InitialState, PlatformModel};

    use super::*;
    use crate::noise::RandomTorque;

    const CELLS: usize = 24;

    /// Two torques, one that drives wheels, and an error of the gyro, from a cell on, and readings that are off in any way: a filter of
    /// so many constants, and of parameters that begin at these cells.
    fn gathered(constants: usize, from: usize, starts: &[usize]) -> Recursive {
        let model = PlatformModel::whorl_1_reference();
        let start = InitialState { wheel_speed_rad_s: vec![40.0, -35.0, 30.0], ..InitialState::default() };
        let mut plant = Plant::new(&model, &start, 1).unwrap().without_random_torque();
        let slow = RandomTorque { stddev_b_n_m: [1e-3; 3], correlation_s: 20.0 };
        let disturbance =
            Disturbance { body: vec![slow], motors_n_m: vec![1e-3; 3], motors_correlation_s: 20.0 };
        let gyrostat = plant.gyrostat().clone();
        let pairs = (0..4).flat_map(|b| (0..=b).map(move |a| (a, b))).collect();
        let mut filter = Recursive::new(&gyrostat, &plant, &disturbance, (constants, 4), pairs);
        filter.forget_motion(1.0, 1.0);
        for cell in 0..CELLS {
            if starts.contains(&cell) {
                filter.begin(0, 2);
            }
            let along = |k: usize| ((cell * (k + 2)) as f64 * 0.3).sin();
            let does = |k: usize| {
                let torque = Vector3::new(along(k), along(k + 1), 1.0) * 1e-2;
                match k {
                    _ if cell < from => Difference::None,
                    3 => Difference::Gyro(torque),
                    _ => Difference::Acceleration(torque, [along(k) * 10.0; 8]),
                }
            };
            filter.push(&plant, (0..4).map(does), 0.1);
            let half_ns = 100_000_000;
            plant.advance_to(plant.now_ns() + 2 * half_ns).unwrap();
            filter.follow(&plant, half_ns);
            let reading = |r: usize| {
                let channel = if r < 3 { Channel::Gyro } else { Channel::WheelSpeed };
                let component = Component::new(channel, 0, r % 3);
                Reading { component, value: 0.01 * ((cell * 7 + r) as f64).cos(), variance: 1e-4 }
            };
            assert!(filter.take_in(&[0, 1, 2, 3, 4, 5].map(reading), Some(0.0)));
            filter.follow(&plant, half_ns);
            filter.move_plant(&mut plant);
        }
        filter
    }

    fn sums(since: &Since) -> (DMatrix<f64>, DVector<f64>) {
        let product = |i: usize, k: usize| since.information[i.max(k) * (i.max(k) + 1) / 2 + i.min(k)];
        (DMatrix::from_fn(4, 4, product), DVector::from_fn(4, |i, _| since.slope[i]))
    }

    #[test]
    fn a_start_in_mid_run_is_what_parameters_do_from_there_on() {
        let (both, later) = (gathered(0, 0, &[0, 12]), gathered(0, 12, &[0]));
        let (found, expected) = (sums(&both.starts[1]), sums(&later.starts[0]));
        assert!(expected.0.amax() > 1.0 && (&found.0 - &expected.0).amax() < 1e-9 * expected.0.amax());
        assert!((&found.1 - &expected.1).amax() < 1e-9 * expected.1.amax());
        let first = sums(&both.starts[0]).0;
        assert!((&found.0 - &first).amax() > 0.1 * first.amax());
    }

    /// Against all parameters as one regression.
    #[test]
    fn constants_are_integrated_out_over_their_priors() {
        let (with, without) = (gathered(2, 0, &[0]), gathered(0, 0, &[0]));
        let (information, slope) = sums(&without.starts[0]);
        let known = information.view((0, 0), (2, 2)) + DMatrix::identity(2, 2);
        let covariance = known.try_inverse().unwrap();
        assert!((&with.covariance - &covariance).amax() < 1e-9 * covariance.amax());
        let across = information.view((2, 0), (2, 2));
        let expected = information.view((2, 2), (2, 2)) - across * &covariance * across.transpose();
        let expected_slope = slope.rows(2, 2) - across * &covariance * slope.rows(0, 2);
        let found = sums(&with.starts[0]);
        assert!((found.0.view((2, 2), (2, 2)) - &expected).amax() < 1e-9 * expected.amax());
        assert!((found.1.rows(2, 2) - &expected_slope).amax() < 1e-9 * expected_slope.amax());
    }
}
