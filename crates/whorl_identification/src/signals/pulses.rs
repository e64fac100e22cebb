//! Pulses of jets that nobody recorded.
//!
//! A platform with jets whose recording does not say when they fired was pushed by them, or was not. What a jet
//! does in a pulse that is short against a window of time is a jump of the rate: seen through longer and longer
//! windows, jumps at any times add up like a random walk, with a variance that grows as the window does. Torques
//! that vary slowly within a window hardly show in the curvature of the rate over it, and grow with the fifth
//! power or more; a line of any frequency shows in some windows and not in others; the noise of the gyro falls
//! as windows grow. So the three can be told apart without knowing any of them.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;

use crate::Settings;
use crate::signals::observed::Observed;

/// Windows of each length that a run set must have: the spread of a variance of fewer is no better than a
/// third.
const LEAST_WINDOWS: f64 = 20.0;

/// Growth of the variance from window to window twice as long. Jumps give 2. Below 1 it is a line's or the
/// noise's. Above, from the first to the second: a torque that lasts as long as the first window gives up to
/// 2^3 (its rate grows along the whole of it), a slow one 2^5 at the least.
const GROWTH: [(f64, f64); 2] = [(1.0, 8.0), (1.0, 4.0)];

/// A tilt this close to the stop may touch it \[rad\].
const NEAR_STOP_RAD: f64 = 0.003;

/// Least variance of the jumps over that of the gyro's noise in the middle window: below it, an error of the noise
/// model could be taken for jumps.
const LEAST_SHARE: f64 = 1.0;

/// Sum of squared curvatures of the unexplained rate, and of what noise gives, in windows of one length.
#[derive(Debug, Clone, Copy, Default)]
struct Curvature {
    square: f64,
    noise: f64,
    windows: f64,
}

impl Curvature {
    /// Mean square above noise.
    fn excess(&self) -> f64 {
        (self.square - self.noise) / self.windows.max(1.0)
    }
}

/// A sentence, if recordings lack the jets' channel and what a fit leaves looks like pulses.
pub(crate) fn pulses(
    observed: &[Observed<'_>],
    model: &PlatformModel,
    settings: &Settings,
) -> Option<String> {
    let is_blank = |run: &&Observed<'_>| {
        let recording = run.recording;
        let drives =
            !recording.wheel_torque_command_n_m.is_empty() || !recording.wheel_speed_rad_s.is_empty();
        !run.clamped && drives && recording.jet_pulses.is_empty() && recording.body_torque_b_n_m.is_empty()
    };
    let runs: Vec<&Observed<'_>> =
        observed.iter().filter(|_| !model.jets().is_empty()).filter(is_blank).collect();
    let mut scales = [Curvature::default(); 3];
    let mut names: Vec<&str> = Vec::new();
    for run in runs {
        let rate = Unexplained::new(run, model);
        let shortest = ((settings.pulse_window_s / run.loud.step_s).round() as usize).max(2);
        let mut own = [Curvature::default(); 3];
        for ((sum, own), times) in scales.iter_mut().zip(&mut own).zip([1, 2, 4]) {
            rate.add(shortest * times, own);
            sum.square += own.square;
            sum.noise += own.noise;
            sum.windows += own.windows;
        }
        if own[1].square > 2.0 * own[1].noise {
            names.push(&run.recording.name);
        }
    }
    looks_like_pulses(&scales).then(|| {
        format!(
            "{}: the body was pushed in short pulses that no channel explains, and the platform has jets whose commands are not in the recording: a verdict on torques would be a guess; record the valves' pulses, or set jets_off: true in the channel map if no jet fired",
            names.join(", ")
        )
    })
}

fn looks_like_pulses(scales: &[Curvature; 3]) -> bool {
    let [first, second, third] = scales;
    let grows = |from: &Curvature, to: &Curvature, (least, most): (f64, f64)| {
        let (from, to) = (from.excess(), to.excess());
        from > 0.0 && to >= least * from && to <= most * from
    };
    third.windows >= LEAST_WINDOWS
        && second.square - second.noise > LEAST_SHARE * second.noise
        && grows(first, second, GROWTH[0])
        && grows(second, third, GROWTH[1])
}

/// The measured rate less what the model makes of it without a random torque, sample by sample, as running sums.
struct Unexplained {
    /// Sum of samples up to each [rad/s], and how many.
    sum: Vec<Vector3<f64>>,
    count: Vec<f64>,
    /// Samples at which something else pushes, up to each.
    barred: Vec<usize>,
    /// Share of the samples that are there.
    per_node: f64,
    /// Variance of one sample about each axis, and what jitter of the commands adds in each.
    sample_variance: Vector3<f64>,
    node_variance: f64,
}

impl Unexplained {
    fn new(run: &Observed<'_>, model: &PlatformModel) -> Self {
        let grid = run.grid(true);
        let (mut sum, mut count, mut barred) = (vec![Vector3::zeros()], vec![0.0], vec![0_usize]);
        let stddev = Vector3::from_fn(|i, _| grid.stddev[i]);
        let mut total = (Vector3::zeros(), 0.0, 0_usize);
        for k in 0..grid.len() {
            if grid.there[0][k] {
                total.0 += Vector3::from_fn(|i, _| grid.inertial[i][k] * stddev[i]);
                total.1 += 1.0;
            }
            // At a stop of the bearing blows are no jets'.
            let tilt_rad = whorl_math::tilt_rad(&run.motion.attitude(grid.time(k)));
            total.2 += usize::from(tilt_rad > model.tilt_limit.max_rad() - NEAR_STOP_RAD);
            sum.push(total.0);
            count.push(total.1);
            barred.push(total.2);
        }
        Self {
            per_node: total.1 / grid.len().max(1) as f64,
            sum,
            count,
            barred,
            sample_variance: stddev.component_mul(&stddev),
            node_variance: 0.0,
        }
    }

    /// Adds the curvatures over windows of `nodes`: a step between two windows, less the mean of the steps
    /// before and after.
    fn add(&self, nodes: usize, to: &mut Curvature) {
        let last = self.sum.len().saturating_sub(1);
        let whole = 0.6 * self.per_node * nodes as f64;
        let mut middle = 3 * nodes;
        while middle + 3 * nodes <= last {
            let at = |offset: usize| (middle + offset * nodes).saturating_sub(3 * nodes);
            let mut step = [Vector3::zeros(); 3];
            let mut inverse = [0.0; 3];
            let mut usable = self.barred[at(6)] == self.barred[at(0)];
            for (i, (step, inverse)) in step.iter_mut().zip(&mut inverse).enumerate() {
                let (a, b, c) = (at(2 * i), at(2 * i + 1), at(2 * i + 2));
                let (before, after) = (self.count[b] - self.count[a], self.count[c] - self.count[b]);
                usable &= before.min(after) > whole;
                *step = (self.sum[c] - self.sum[b]) / after - (self.sum[b] - self.sum[a]) / before;
                *inverse = 1.0 / before + 1.0 / after;
            }
            middle += nodes;
            if !usable {
                continue;
            }
            let curvature = step[1] - (step[0] + step[2]) * 0.5;
            to.square += curvature.norm_squared();
            to.noise += self.sample_variance.sum() * (inverse[1] + 0.25 * (inverse[0] + inverse[2]))
                + self.node_variance * nodes as f64;
            to.windows += 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal, StandardUniform};
    use rand_pcg::Pcg64;

    use super::*;

    const NODE_S: f64 = 0.04;
    const SAMPLES: f64 = 8.0;

    /// Noise of one sample 1 mrad/s, eight samples a node, and this rate on top.
    fn scales(duration_s: f64, rate_rad_s: impl Fn(f64) -> f64) -> [Curvature; 3] {
        let mut random = Pcg64::new(5, 0);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let nodes = (duration_s / NODE_S) as usize;
        let (mut sum, mut count) = (vec![Vector3::zeros()], vec![0.0]);
        let mut total = (Vector3::zeros(), 0.0);
        for k in 0..nodes {
            let noise = Vector3::from_fn(|_, _| 1e-3 * normal() / SAMPLES.sqrt());
            let mean = noise + Vector3::new(rate_rad_s(k as f64 * NODE_S), 0.0, 0.0);
            total.0 += mean * SAMPLES;
            total.1 += SAMPLES;
            sum.push(total.0);
            count.push(total.1);
        }
        let rate = Unexplained {
            barred: vec![0; sum.len()],
            sum,
            count,
            per_node: SAMPLES,
            sample_variance: Vector3::repeat(1e-6),
            node_variance: 0.0,
        };
        let mut scales = [Curvature::default(); 3];
        for (slot, nodes) in scales.iter_mut().zip([6, 12, 24]) {
            rate.add(nodes, slot);
        }
        scales
    }

    /// Rate from pulses of 3 s^-1 on average, each of this length, that push by +-1 mrad/s.
    fn pulsed(length_s: f64) -> impl Fn(f64) -> f64 {
        let mut random = Pcg64::new(11, 0);
        let mut uniform = move || -> f64 { StandardUniform.sample(&mut random) };
        let mut pulses = Vec::new();
        let mut time_s = 0.0;
        while time_s < 90.0 {
            time_s += 0.05 + 0.56 * uniform();
            pulses.push((time_s, if uniform() < 0.5 { -1e-3 } else { 1e-3 }));
        }
        move |t| pulses.iter().map(|(on, jump)| jump * ((t - on) / length_s).clamp(0.0, 1.0)).sum()
    }

    #[test]
    fn pulses_of_any_usual_length_are_seen() {
        for length_s in [0.02, 0.1, 0.3] {
            let scales = scales(90.0, pulsed(length_s));
            assert!(looks_like_pulses(&scales), "{length_s}: {scales:?}");
        }
    }

    #[test]
    fn noise_slow_torques_steps_and_lines_are_no_pulses() {
        assert!(!looks_like_pulses(&scales(90.0, |_| 0.0)));
        // A rate that wanders slowly, and fast enough to be far above the noise.
        let slow = |t: f64| 0.3 * (0.2 * t).sin() + 0.1 * (0.7 * t).cos();
        assert!(!looks_like_pulses(&scales(90.0, slow)));
        for tenths in 1..30 {
            let hz = 0.1 * f64::from(tenths);
            let line = |t: f64| 0.02 * (std::f64::consts::TAU * hz * t).sin();
            let scales = scales(90.0, line);
            assert!(!looks_like_pulses(&scales), "{hz} Hz: {scales:?}");
        }
        // A torque that is switched every few seconds: the rate has corners, not jumps.
        let switched = |t: f64| 2e-3 * (t % 6.0 - 3.0).abs();
        assert!(!looks_like_pulses(&scales(90.0, switched)));
    }
}
