//! Lines too fast for the bins of the regression: vibration of the sensors, unbalanced wheels.
//!
//! Far above the platform's own motion the gyro's and the accelerometer's samples are noise plus what shakes
//! the sensors, so a slow mean taken off the samples is all the model that is needed.

mod commands;
mod imbalance;
mod line;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Signature, catalogue};
use whorl_trajectory::noise::typical_step_s;

use crate::Settings;
use crate::bins::motion::Motion;
use crate::bins::run::Run;
use crate::diagnosis::{Candidate, ParameterEstimate};
use crate::explanations::place::Place;
use crate::parameters::Point;
use crate::whitening::columns::predict;
use crate::whitening::mechanics::Mechanics;

/// Samples of a run on an even grid, at most: stamps may hold anything.
const MOST_SAMPLES: f64 = 4e6;

/// The fast part of the samples of one run on an even grid, in standard deviations of their noise; lost
/// samples are zero. First the gyro's axes, then the accelerometer's.
struct Fast<'a> {
    settings: Settings,
    run: &'a Run,
    motion: &'a Motion,
    start_s: f64,
    step_s: f64,
    channel: [Vec<f64>; 6],
    there: [Vec<bool>; 2],
    /// Standard deviation of one sample of each channel.
    stddev: [f64; 6],
}

impl<'a> Fast<'a> {
    fn new(run: &'a Run, motion: &'a Motion, mechanics: &Mechanics, settings: Settings) -> Option<Self> {
        if run.clamped || run.raw_gyro.len() < 500 {
            return None;
        }
        let (_, prediction) = predict(mechanics, run, motion);
        let (start_s, step_s) = sample_clock(&run.raw_gyro.time_s)?;
        let last_s = *run.raw_gyro.time_s.last()?;
        let count = ((last_s - start_s) / step_s).round().clamp(0.0, MOST_SAMPLES) as usize + 1;
        let mut channel: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; count]);
        let mut there = [vec![false; count], vec![false; count]];
        for (sensor, (samples, predicted)) in
            [(&run.raw_gyro, &prediction.gyro), (&run.raw_accel, &prediction.accel)].into_iter().enumerate()
        {
            for (t, y) in samples.time_s.iter().zip(&samples.value) {
                let at = ((t - start_s) / step_s).round();
                if at < 0.0 || at >= count as f64 {
                    continue;
                }
                let k = run.node_at(*t);
                let (Some(a), Some(b)) = (predicted.get(k), predicted.get(k + 1).or(predicted.get(k))) else {
                    continue;
                };
                let share = ((t - run.time(k)) / run.length_or_zero(k).max(1e-6)).clamp(0.0, 1.0);
                let d = y - a.lerp(b, share);
                let at = at as usize;
                there[sensor][at] = true;
                let axes = if sensor == 0 { run.gyro_axes } else { run.accel_axes };
                for i in (0..3).filter(|i| axes[*i]) {
                    channel[3 * sensor + i][at] = d[i];
                }
            }
        }
        let noise = &run.noise;
        let stddev: [f64; 6] =
            std::array::from_fn(|c| if c < 3 { noise.gyro[c] } else { noise.accel[c - 3] }.max(1e-12));
        for (c, values) in channel.iter_mut().enumerate() {
            fast_part(values, &there[c / 3], step_s, half_window_s(&settings));
            // An edge of a jet is no vibration.
            values.iter_mut().for_each(|x| *x = (*x / stddev[c]).clamp(-5.0, 5.0));
        }
        let mut fast = Self { settings, run, motion, start_s, step_s, channel, there, stddev };
        commands::take_off(&mut fast, mechanics);
        Some(fast)
    }

    /// Takes the local mean off a series of the gyro or of the accelerometer, from this sample on.
    fn fast_part(&self, values: &mut [f64], sensor: usize, from: usize) {
        let there = &self.there[sensor][from..from + values.len()];
        fast_part(values, there, self.step_s, half_window_s(&self.settings));
    }

    fn time(&self, index: usize) -> f64 {
        self.start_s + index as f64 * self.step_s
    }

    fn len(&self) -> usize {
        self.channel[0].len()
    }

    /// 1 while any valve is open, else 0.
    fn valves(&self) -> Vec<f64> {
        let mut open = vec![0.0; self.len()];
        for pulse in self.run.jet_pulses.iter().flatten() {
            let index =
                |t: f64| (((t - self.start_s) / self.step_s).max(0.0).ceil() as usize).min(open.len());
            let (from, to) = (index(pulse.on_s), index(pulse.off_s));
            open[from..to.max(from)].fill(1.0);
        }
        open
    }
}

/// Start and step of the sensor's own clock, from stamps that jitter \[s\]. The median of thousands of steps that
/// jitter by a twentieth is off by 10^-3 of a step, which is several samples over a run: a line near half the sample
/// rate would lose half its power.
fn sample_clock(stamps_s: &[f64]) -> Option<(f64, f64)> {
    let first_s = *stamps_s.first()?;
    let (mut start_s, mut step_s) = (first_s, typical_step_s(stamps_s).max(1e-4));
    for _ in 0..2 {
        // The sample's number follows the stamps slowly, so that no single one of them makes it slip.
        let (mut number, mut expected_s) = (0.0, start_s);
        let (mut count, mut sums, mut squares, mut products) = (0.0, (0.0, 0.0), 0.0, 0.0);
        for t in stamps_s {
            let steps = ((t - expected_s) / step_s).round().max(0.0);
            number += steps;
            expected_s += steps * step_s;
            expected_s += 0.05 * (t - expected_s);
            let since_first_s = t - first_s;
            count += 1.0;
            sums = (sums.0 + number, sums.1 + since_first_s);
            squares += number * number;
            products += number * since_first_s;
        }
        let spread = squares - sums.0 * sums.0 / count;
        if spread <= 0.0 {
            return None;
        }
        step_s = ((products - sums.0 * sums.1 / count) / spread).max(1e-4);
        start_s = first_s + (sums.1 - step_s * sums.0) / count;
    }
    Some((start_s, step_s))
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

fn parameter(name: String, unit: &str, estimate: f64, stddev: f64) -> ParameterEstimate {
    ParameterEstimate {
        name,
        unit: unit.to_owned(),
        estimate,
        stddev,
        at_bound: false,
        smallest_detectable: 5.0 * stddev,
    }
}

fn row(effect: &dyn Effect, drop: f64, evidence: f64, parameters: Vec<ParameterEstimate>) -> Candidate {
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

/// What the samples show.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    pub rows: Vec<Candidate>,
    /// Wheels whose turning shows.
    pub turning: Vec<usize>,
}

/// Fast effects that the samples show about a model at a point: an unbalanced wheel, a vibration.
pub(crate) fn fast_effects(place: Place<'_>, point: &Point, exclude: &[String]) -> Seen {
    let tested = |id: &str| {
        place.design.candidates.iter().any(|c| c.id == id)
            || (!exclude.iter().any(|e| e == id) && !place.problem.reference.model.effects.contains_key(id))
    };
    let Some(mechanics) = place.problem.reference.model_at(point).ok().and_then(|m| Mechanics::new(&m).ok())
    else {
        return Seen::default();
    };
    let mut runs: Vec<Fast<'_>> = place
        .problem
        .runs
        .iter()
        .zip(place.problem.motions.iter())
        .filter_map(|(run, motion)| Fast::new(run, motion, &mechanics, place.problem.reference.settings))
        .collect();
    let mut seen = Seen::default();
    // What turns with a wheel is taken off the samples before a line of its own is looked for.
    for effect in catalogue().iter().copied().filter(|effect| tested(effect.info().id)) {
        if effect.signature() == Some(Signature::WheelTurn)
            && let Some((wheel, row)) = imbalance::imbalance(&mut runs, &mechanics, effect)
        {
            seen.turning.push(wheel);
            seen.rows.push(row);
        }
    }
    for effect in catalogue().iter().copied().filter(|effect| tested(effect.info().id)) {
        if let Some(Signature::SensorLine { gyro, accelerometer, frequency, background }) = effect.signature()
        {
            let ([a, b, c], [d, e, f]) = (gyro, accelerometer);
            let names = line::Names { amplitude: [a, b, c, d, e, f], frequency, background };
            seen.rows.extend(line::vibration(&runs, effect, &names));
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    #[test]
    fn the_clock_is_found_behind_stamps_that_jitter() {
        let mut random = Pcg64::new(4, 2);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let step_s = 0.010_003;
        // Every hundredth sample is lost, and a second of them.
        let stamps_s: Vec<f64> = (0..9000_u32)
            .filter(|i| i % 100 != 7 && !(4000..4100).contains(i))
            .map(|i| 5.0 + step_s * f64::from(i) + 5e-4 * noise())
            .collect();
        let (start_s, found_s) = sample_clock(&stamps_s).unwrap();
        assert!((start_s - 5.0).abs() < 1e-4, "{start_s}");
        // A twentieth of a sample over the whole run.
        assert!((found_s - step_s).abs() * 9000.0 < 0.05 * step_s, "{found_s}");
    }
}
