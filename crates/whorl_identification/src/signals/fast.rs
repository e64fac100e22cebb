//! Lines too fast for a platform's own motion: vibration of the sensors, unbalanced wheels.
//!
//! Far above the platform's own motion the gyro's and the accelerometer's innovations are noise plus what shakes
//! the sensors, so a slow mean taken off them is all the model that is needed.

use nalgebra::Matrix3;
use whorl_dynamics::{Effect, Gyrostat, PlatformModel};

use crate::Settings;
use crate::signals::observed::Observed;
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Fewest samples of the gyro in which a vibration is looked for.
const FEWEST: usize = 500;
/// An edge of a jet is no vibration: so many deviations at most.
const MOST_DEVIATIONS: f64 = 5.0;

/// The fast part of the innovations of one run on an even grid, in standard deviations of their noise; lost
/// samples are zero. First the gyro's axes, then the accelerometer's.
pub(super) struct Fast<'a> {
    pub settings: Settings,
    pub run: &'a Observed<'a>,
    pub start_s: f64,
    pub step_s: f64,
    pub channel: [Vec<f64>; 6],
    pub there: [Vec<bool>; 2],
    /// Standard deviation of one sample of each channel.
    pub stddev: [f64; 6],
}

impl<'a> Fast<'a> {
    pub fn new(run: &'a Observed<'a>, settings: Settings) -> Option<Self> {
        let grid = &run.loud;
        if run.clamped || grid.there[0].iter().filter(|there| **there).count() < FEWEST {
            return None;
        }
        let (mut channel, there) = (grid.inertial.clone(), grid.there.clone());
        for (c, values) in channel.iter_mut().enumerate() {
            fast_part(values, &there[c / 3], grid.step_s, half_window_s(&settings));
            values.iter_mut().for_each(|x| *x = x.clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS));
        }
        let stddev = grid.stddev.map(|stddev| stddev.max(1e-12));
        let (start_s, step_s) = (grid.start_s, grid.step_s);
        Some(Self { settings, run, start_s, step_s, channel, there, stddev })
    }

    /// Takes the local mean off a series of the gyro or of the accelerometer, from this sample on.
    pub fn fast_part(&self, values: &mut [f64], sensor: usize, from: usize) {
        let there = &self.there[sensor][from..from + values.len()];
        fast_part(values, there, self.step_s, half_window_s(&self.settings));
    }

    pub fn time(&self, index: usize) -> f64 {
        self.start_s + index as f64 * self.step_s
    }

    pub fn len(&self) -> usize {
        self.channel[0].len()
    }

    /// 1 while any valve is open, else 0.
    pub fn valves(&self) -> Vec<f64> {
        let mut open = vec![0.0; self.len()];
        for pulse in self.run.recording.jet_pulses.iter().flatten() {
            let index =
                |t: f64| (((t - self.start_s) / self.step_s).max(0.0).ceil() as usize).min(open.len());
            let (from, to) = (index(pulse.on_s), index(pulse.off_s));
            open[from..to.max(from)].fill(1.0);
        }
        open
    }
}

/// The mean over this much on both sides is taken off every sample \[s\].
fn half_window_s(settings: &Settings) -> f64 {
    0.6 / settings.slowest_vibration_hz
}

/// Takes the local mean off every value.
fn fast_part(values: &mut [f64], there: &[bool], step_s: f64, half_window_s: f64) {
    let half = (half_window_s / step_s).round().max(2.0) as usize;
    let mut sums = Vec::with_capacity(values.len() + 1);
    sums.push((0.0, 0.0));
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, is_there) in values.iter().zip(there) {
        if *is_there {
            sum += x;
            count += 1.0;
        }
        sums.push((sum, count));
    }
    for (i, x) in values.iter_mut().enumerate() {
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(there.len()));
        let (a, b) = (sums[from], sums[to]);
        *x = if there[i] && b.1 - a.1 > half as f64 { *x - (b.0 - a.0) / (b.1 - a.1) } else { 0.0 };
    }
}

pub(super) fn parameter(name: String, unit: &str, estimate: f64, stddev: f64) -> ParameterEstimate {
    ParameterEstimate {
        name,
        unit: unit.to_owned(),
        estimate,
        stddev,
        at_bound: false,
        smallest_detectable: 5.0 * stddev,
    }
}

pub(super) fn row(
    effect: &dyn Effect,
    drop: f64,
    evidence: f64,
    parameters: Vec<ParameterEstimate>,
) -> Candidate {
    Candidate {
        effect: effect.info().id.to_owned(),
        delta_log_evidence: evidence,
        held_out_gain: None,
        share_of_excess: 1.0,
        swallowed_by_base: 0.0,
        detectability: drop,
        indistinguishable_from: Vec::new(),
        parameters,
    }
}

/// Rates of the body by a torque on it with wheels that turn freely [1/(kg m^2)].
pub(super) fn inverse_inertia(model: &PlatformModel) -> Matrix3<f64> {
    Gyrostat::new(model).map_or_else(|_| Matrix3::zeros(), |of| *of.rate_equation().inverse_resisting())
}
