//! The fast part of the innovations of gyro and accelerometer: noise plus what shakes the sensors, far above the platform's own motion.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::noise::take_off_local_mean;

use crate::Settings;
use crate::signals::observed::{Grid, Observed};

/// Fewest samples of the gyro in which a vibration is looked for.
const FEWEST: usize = 500;
/// An edge of a jet is no vibration: so many deviations at most.
const MOST_DEVIATIONS: f64 = 5.0;
/// Samples by which an answer may lag behind the pulses of jets.
const LAGS: usize = 4;

/// The fast part of one run, in standard deviations of its noise; lost samples are zero.
pub(super) struct Fast<'a> {
    pub run: &'a Observed<'a>,
    pub grid: &'a Grid,
    /// The gyro's axes, then the accelerometer's.
    pub channel: [Vec<f64>; 6],
    /// The mean over so many samples to both sides is taken off every one.
    half_window: usize,
}

impl<'a> Fast<'a> {
    pub fn new(run: &'a Observed<'a>, model: &PlatformModel, settings: &Settings) -> Option<Self> {
        let grid = &run.loud;
        if run.clamped || grid.there[0].iter().filter(|there| **there).count() < FEWEST {
            return None;
        }
        let half_window = (0.6 / settings.slowest_vibration_hz / grid.step_s).round().max(2.0) as usize;
        let mut fast = Self { run, grid, channel: grid.inertial.clone(), half_window };
        for (c, values) in fast.channel.iter_mut().enumerate() {
            take_off_local_mean(values, &grid.there[c / 3], half_window);
            values.iter_mut().for_each(|x| *x = x.clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS));
        }
        fast.take_off_pulses(model);
        Some(fast)
    }

    pub fn stddev(&self, channel: usize) -> f64 {
        self.grid.stddev[channel].max(1e-12)
    }

    /// Takes the local mean off a series of the gyro (0) or of the accelerometer (1), from this sample on.
    pub fn fast_part(&self, values: &mut [f64], sensor: usize, from: usize) {
        let there = &self.grid.there[sensor][from..from + values.len()];
        take_off_local_mean(values, there, self.half_window);
    }

    /// Samples while a span of time lasts, as a fractional range of the grid.
    fn samples(&self, on_s: f64, off_s: f64) -> (f64, f64) {
        let at = |time_s: f64| ((time_s - self.grid.start_s) / self.grid.step_s).max(0.0);
        (at(on_s), at(off_s))
    }

    /// 1 while any valve is open, else 0.
    pub fn valves(&self) -> Vec<f64> {
        let mut open = vec![0.0; self.grid.len()];
        for pulse in self.run.recording.jet_pulses.iter().flatten() {
            let (on, off) = self.samples(pulse.on_s, pulse.off_s);
            let from = on.ceil() as usize;
            open.iter_mut().take(off.ceil() as usize).skip(from).for_each(|open| *open = 1.0);
        }
        open
    }

    /// Takes off every channel what a short linear filter of the pulses' torque explains. Pulses come in slots, with all their harmonics, and what
    /// answers them differently from the model is coherent with them, and no vibration (Bendat and Piersol 2010, section 6.2).
    fn take_off_pulses(&mut self, model: &PlatformModel) {
        let (run, length) = (self.run.recording, self.grid.len());
        if run.jet_pulses.iter().all(Vec::is_empty) {
            return;
        }
        // The mean torque over the interval that ends with each sample,
        let mut torques = vec![Vector3::zeros(); length];
        for (jet, pulses) in model.jets().iter().zip(&run.jet_pulses) {
            for pulse in pulses {
                let delays_s = (jet.opening_delay_s, jet.closing_delay_s);
                let (on, off) = self.samples(pulse.on_s + delays_s.0, pulse.off_s + delays_s.1);
                let open = torques.iter_mut().enumerate().take(off.ceil() as usize + 1).skip(on as usize);
                for (k, torque) in open {
                    let share = ((k as f64).min(off) - (k as f64 - 1.0).max(on)).clamp(0.0, 1.0);
                    *torque += jet.torque_b_n_m() * share;
                }
            }
        }
        // about each axis, behind them the rates that these add up to.
        let mut inputs: [Vec<f64>; 6] = Default::default();
        let mut rate = Vector3::zeros();
        for torque in torques {
            rate += torque;
            inputs.iter_mut().zip(torque.iter().chain(&rate)).for_each(|(input, x)| input.push(*x));
        }
        for sensor in 0..2 {
            let delayed = |(input, lag): (&Vec<f64>, usize)| {
                let mut column = vec![0.0; length];
                column.iter_mut().skip(lag).zip(input).for_each(|(slot, x)| *slot = *x);
                self.fast_part(&mut column, sensor, 0);
                DVector::from_vec(column)
            };
            let lagged = inputs.iter().flat_map(|input| (0..LAGS).map(move |lag| (input, lag)));
            let columns = DMatrix::from_columns(&lagged.map(delayed).collect::<Vec<_>>());
            let normal = columns.tr_mul(&columns);
            // Columns that hold the same are not told apart, nor need they be.
            let ridge = DMatrix::identity(normal.nrows(), normal.nrows()) * (1e-9 * normal.diagonal().amax());
            let Some(factor) = (normal + ridge).cholesky() else { continue };
            for channel in &mut self.channel[3 * sensor..3 * sensor + 3] {
                let values = DVector::from_column_slice(channel);
                let left = &values - &columns * factor.solve(&columns.tr_mul(&values));
                channel.copy_from_slice(left.as_slice());
            }
        }
    }
}
