//! The filter for readings as they arrive: gains, columns and sums of a pass over a recording, from reading to reading.
//!
//! A plant goes ahead, which the caller moves with what the actuators did; the filter's state is how far the platform is from it. Readings of
//! gyro and wheel speeds correct it, also such as are means over a short time: they then stand in its middle. The attitude is given.
//!
//! What was found since the last [`Window`] was taken is summed. With x the filter's state at its beginning, theta the parameters and e the
//! innovations, de/dx and de/dtheta are the columns, theta beginning with the window; what windows say together of parameters that began
//! before follows from that ([`Window`]).

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, RATE, ROTATION};
use whorl_dynamics::{Gyrostat, Plant};
use whorl_recording::{Channel, Component};

use crate::blocks::Blocks;
use crate::gains::Gains;
use crate::lanes::{Lanes, MOST_STATES, dot};
use crate::laws::add_rates_by_torque;
use crate::layout::Layout;
use crate::noise::Disturbance;
use crate::perturbed::Difference;
use crate::rows::{Readings, Row};
use crate::settings::Settings;

/// A filter for readings as they arrive.
pub struct Recursive {
    layout: Layout,
    gains: Gains<'static>,
    blocks: Blocks,
    /// Parameters, of which what any two of the first do together is found.
    parameters: usize,
    /// How far the platform is from the plant, and what the state has besides.
    state: [f64; MOST_STATES],
    /// Columns of which the gyro reads otherwise in the present state.
    of_gyro: Vec<(usize, Vector3<f64>)>,
    readings: Readings,
    values: Vec<f64>,
    numbers: usize,
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

/// What was found in a window of time, of a state with n coordinates and p parameters.
#[derive(Debug, Clone)]
pub struct Window {
    /// n x n: how the state at the end changes with that at the beginning.
    pub transition: DMatrix<f64>,
    /// n x p: how the state at the end changes with parameters that begin with the window.
    pub moved: DMatrix<f64>,
    /// n x n and n x p: sums of de/dx de/dx^T and de/dx de/dtheta^T over the variances.
    pub by_state: (DMatrix<f64>, DMatrix<f64>),
    /// Of the first parameters by all: sums of de/dtheta de/dtheta^T over the variances.
    pub by_first: DMatrix<f64>,
    /// The same of the pairs that were asked for.
    pub pairs: Vec<f64>,
    /// Minus the sums of e de/dx and e de/dtheta over the variances: slopes of log p.
    pub slope: (DVector<f64>, DVector<f64>),
    /// Sums of |de/dtheta| over the deviations.
    pub absolute: DVector<f64>,
    /// Innovations.
    pub numbers: usize,
}

impl Recursive {
    /// About a plant of a platform, with these random torques. Of `parameters`, what any two of the first do together is found, and of those behind
    /// what two do that are less than `apart` from each other. Nothing is uncertain yet: see [`Self::set_variance`].
    #[must_use]
    pub fn new(
        gyrostat: &Gyrostat,
        plant: &Plant,
        disturbance: &Disturbance,
        settings: Settings,
        (first, parameters): (usize, usize),
        apart: usize,
    ) -> Self {
        let processes = disturbance.processes().count();
        let layout = Layout::new(plant.tangent(), processes, disturbance.motors(), true, false);
        let mut hidden_noise = vec![0.0; gyrostat.effects().hidden_states()];
        gyrostat.effects().hidden_noise(&mut hidden_noise);
        let sensors = &gyrostat.model().sensors;
        let walks = (0..layout.size()).map(|i| layout.walk_variance(sensors, &hidden_noise, i)).collect();
        let mut linearised = LinearisedPlant::none(plant);
        plant.linearise_into(&mut linearised, true);
        let covariance = Lanes::zeros(layout.size(), layout.size());
        let disturbance: Cow<'static, Disturbance> = Cow::Owned(disturbance.clone());
        let mut gains =
            Gains::of(settings, disturbance.clone(), layout, walks, &[], covariance, linearised, plant);
        for (i, stddev) in disturbance.coordinates(layout) {
            gains.covariance.row_mut(i)[i] = stddev * stddev;
        }
        Self {
            layout,
            gains,
            blocks: Blocks::new(layout, true, first, parameters - first, apart).with_absolute(),
            parameters: first,
            state: [0.0; MOST_STATES],
            of_gyro: Vec::new(),
            readings: Readings::default(),
            values: Vec::new(),
            numbers: 0,
        }
    }

    /// Where each part of the state stands.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Nothing is known of a coordinate but this variance about the plant's, or about zero.
    pub fn set_variance(&mut self, i: usize, variance: f64) {
        self.gains.hold(i);
        self.gains.covariance.row_mut(i)[i] = variance;
        self.state[i] = 0.0;
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

    /// From now on no parameter does anything.
    pub fn rest(&mut self) {
        self.blocks.rest();
        self.of_gyro.clear();
    }

    /// What a parameter does otherwise from now on, over steps of this length \[s\].
    pub fn push(&mut self, plant: &Plant, parameter: usize, does: &Difference, step_s: f64) {
        let column = self.layout.size() + parameter;
        let (blocks, half_s) = (&mut self.blocks, 0.5 * step_s);
        match does {
            Difference::None => {}
            Difference::Torque(body, wheels) => {
                let wheels = wheels.map(|torque| torque * half_s);
                let mut add = |i: usize, rate: f64| blocks.push(column, i, rate);
                add_rates_by_torque(plant, &self.gains.linearised, body * half_s, &wheels, &mut add);
            }
            Difference::Acceleration(body, wheels) => {
                RATE.zip(body).for_each(|(i, rate)| blocks.push(column, i, rate * half_s));
                let turning = plant.held_wheels().zip(wheels).zip(plant.tangent().wheels());
                let turning = turning.filter(|((held, rate), _)| !held && **rate != 0.0);
                turning.for_each(|((_, rate), i)| blocks.push(column, i, rate * half_s));
            }
            Difference::Gyro(more) => self.of_gyro.push((column, *more)),
        }
    }

    /// Follows a step that the plant has made.
    pub fn follow(&mut self, plant: &Plant, step_ns: i64) {
        self.gains.set_out();
        self.gains.follow(plant, step_ns);
        let (transition, before) = (&self.gains.step.transition, self.state);
        for (x, row) in self.state.iter_mut().zip(transition.rows()) {
            *x += dot(row, &before);
        }
        self.blocks.carry(transition);
        let held = plant.tangent().wheels().zip(plant.held_wheels()).filter(|(_, held)| *held);
        for i in ROTATION.chain(held.map(|(i, _)| i)) {
            self.gains.hold(i);
            self.blocks.hold(i);
            self.state[i] = 0.0;
        }
    }

    /// Corrects the state by readings of one instant; false where the covariance is none any more.
    pub fn take_in(&mut self, readings: &[Reading]) -> bool {
        let rows = &mut self.readings;
        rows.rows.clear();
        rows.by_state.clear();
        rows.variances.clear();
        for Reading { component, value, variance } in readings {
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
            let value = value - dot(rows.by_state.row(rows.rows.len()), &self.state);
            rows.rows.push(Row::now(*component, 0, 0, f64::NAN, value));
        }
        if !self.gains.correct(rows) {
            return false;
        }
        let gain = &self.gains.gain;
        self.values.clear();
        for (r, row) in rows.rows.iter().enumerate() {
            let before = gain.couplings(r).iter().zip(&self.values);
            let value = row.value - before.map(|(coupling, e)| coupling * e).sum::<f64>();
            self.values.push(value);
            self.state.iter_mut().zip(gain.of(r)).for_each(|(x, gain)| *x += gain * value);
        }
        self.blocks.clear_readings(rows.rows.len());
        for (column, more) in &self.of_gyro {
            let gyro = rows.rows.iter().enumerate().filter(|(_, row)| row.component.channel == Channel::Gyro);
            gyro.for_each(|(r, row)| self.blocks.set_reading(*column, r, -more[row.component.index()]));
        }
        self.blocks.take_in(rows, gain, &self.values);
        self.numbers += self.values.len();
        self.values.iter().all(|value| value.is_finite())
    }

    /// Of the readings that were taken in last: their innovations over their deviations.
    pub fn innovations(&self) -> impl Iterator<Item = f64> + '_ {
        self.values.iter().zip(&self.gains.gain.variances).map(|(value, variance)| value / variance.sqrt())
    }

    /// How each of them changes with a parameter that began with the window, over its deviation.
    pub fn of_parameter(&self, reading: usize, parameter: usize) -> f64 {
        self.of_column(reading, self.layout.size() + parameter)
    }

    /// The same of a coordinate of the state at the beginning of the window.
    pub fn of_state(&self, reading: usize, coordinate: usize) -> f64 {
        self.of_column(reading, coordinate)
    }

    fn of_column(&self, reading: usize, column: usize) -> f64 {
        let variance = self.gains.gain.variances.get(reading).copied().unwrap_or(f64::INFINITY);
        self.blocks.of_innovation(reading, column) / variance.sqrt()
    }

    /// Moves the plant to where the platform is believed to be.
    pub fn move_plant(&mut self, plant: &mut Plant) {
        let own = &mut self.state[..self.layout.plant.size()];
        plant.change_state(own);
        own.fill(0.0);
    }

    /// What was found since the window before, with what these pairs of parameters do together; a new one begins.
    pub fn window(&mut self, pairs: &[(usize, usize)]) -> Window {
        let n = self.layout.size();
        let p = self.blocks.count().0 - n;
        let at = |blocks: &Blocks, first: usize, columns: usize| {
            DMatrix::from_fn(n, columns, |i, k| blocks.at(i, first + k))
        };
        let (transition, moved) = (at(&self.blocks, 0, n), at(&self.blocks, n, p));
        let (sum, slope, absolute) = self.blocks.so_far();
        let window = Window {
            transition,
            moved,
            by_state: (
                DMatrix::from_fn(n, n, |i, k| sum.product(i, k)),
                DMatrix::from_fn(n, p, |i, k| sum.product(i, n + k)),
            ),
            by_first: DMatrix::from_fn(self.parameters, p, |i, k| sum.product(n + i, n + k)),
            pairs: pairs.iter().map(|(a, b)| sum.product(n + a, n + b)).collect(),
            slope: (slope.rows(0, n).into_owned(), slope.rows(n, p).into_owned()),
            absolute: absolute.rows(n, p).into_owned(),
            numbers: std::mem::take(&mut self.numbers),
        };
        self.blocks.begin();
        window
    }
}
