//! Lines too fast for the bins of the regression: vibration of the sensors, unbalanced wheels.
//!
//! Far above the platform's own motion the gyro's and the accelerometer's samples are noise plus what shakes
//! the sensors, so a slow mean taken off the samples is all the model that is needed.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix2, Vector2, Vector3};

use whorl_math::unit_or;

use crate::bins::median_step_s;
use crate::columns::predict;
use crate::diagnosis::{Candidate, ParameterEstimate};
use crate::mechanics::Mechanics;
use crate::motion::Motion;
use crate::run::Run;
use crate::search::{LEAST_DROP, LEAST_TOGETHER, Search, point_of};
use crate::spectrum::Spectrum;

/// The mean over this much on both sides is taken off every sample \[s\].
const HALF_WINDOW_S: f64 = 0.15;

/// Slower lines belong to the regression \[Hz\].
const SLOWEST_HZ: f64 = 4.0;

/// Cycles a turn at which no imbalance is: what is there is noise.
const BESIDE: [f64; 4] = [0.79, 0.9, 1.11, 1.23];

/// Turns of the iteration that finds one motion of the sensors in all runs.
const MOST_TURNS: usize = 60;

/// An imbalance may be anything within this factor: from a balanced flywheel to a bent one.
const SIZES_OF_IMBALANCE: f64 = 1e4;

/// Samples of a run on an even grid, at most: stamps may hold anything.
const MOST_SAMPLES: f64 = 4e6;

/// Wheel angles integrated from their speeds stay good for this long \[s\].
const COHERENT_S: f64 = 30.0;

/// The fast part of the samples of one run on an even grid, in standard deviations of their noise; lost
/// samples are zero. First the gyro's axes, then the accelerometer's.
struct Fast<'a> {
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
    fn new(run: &'a Run, motion: &'a Motion, mechanics: &Mechanics) -> Option<Self> {
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
                for i in 0..3 {
                    channel[3 * sensor + i][at] = d[i];
                }
            }
        }
        let noise = &run.noise;
        let stddev: [f64; 6] =
            std::array::from_fn(|c| if c < 3 { noise.gyro[c] } else { noise.accel[c - 3] }.max(1e-12));
        for (c, values) in channel.iter_mut().enumerate() {
            fast_part(values, &there[c / 3], step_s);
            // An edge of a jet is no vibration.
            values.iter_mut().for_each(|x| *x = (*x / stddev[c]).clamp(-5.0, 5.0));
        }
        Some(Self { run, motion, start_s, step_s, channel, there, stddev })
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
    let (mut start_s, mut step_s) = (first_s, median_step_s(stamps_s).max(1e-4));
    for _ in 0..2 {
        // The sample's number follows the stamps slowly, so that no single one of them makes it slip.
        let (mut number, mut expected_s) = (0.0, start_s);
        let (mut count, mut sums, mut squares, mut products) = (0.0, (0.0, 0.0), 0.0, 0.0);
        for t in stamps_s {
            let steps = ((t - expected_s) / step_s).round().max(0.0);
            number += steps;
            expected_s += steps * step_s;
            expected_s += 0.05 * (t - expected_s);
            let late_s = t - first_s;
            count += 1.0;
            sums = (sums.0 + number, sums.1 + late_s);
            squares += number * number;
            products += number * late_s;
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

/// Takes the mean of the surroundings off every value.
fn fast_part(values: &mut [f64], there: &[bool], step_s: f64) {
    let half = (HALF_WINDOW_S / step_s).round().max(2.0) as usize;
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

fn row(effect: &str, drop: f64, evidence: f64, parameters: Vec<ParameterEstimate>) -> Candidate {
    Candidate {
        effect: effect.to_owned(),
        delta_log_evidence: evidence,
        held_out_gain: evidence,
        share_of_excess: 1.0,
        swallowed_by_base: 0.0,
        detectability: drop,
        indistinguishable_from: Vec::new(),
        parameters,
    }
}

/// Fast effects that the samples show: an unbalanced wheel, a vibration.
pub(crate) fn fast_effects(search: &Search<'_>) -> Vec<Candidate> {
    let tested = |id: &str| {
        search.layout.candidates.iter().any(|c| c.id == id)
            || (!search.options.exclude.iter().any(|e| e == id)
                && !search.problem.reference.model.effects.contains_key(id))
    };
    let point = point_of(search.problem, &search.layout, &search.point, &search.best);
    let Some(mechanics) =
        search.problem.reference.model_at(&point).ok().and_then(|m| Mechanics::new(&m).ok())
    else {
        return Vec::new();
    };
    let mut runs: Vec<Fast<'_>> = search
        .problem
        .runs
        .iter()
        .zip(&search.problem.motions)
        .filter_map(|(run, motion)| Fast::new(run, motion, &mechanics))
        .collect();
    let mut found = Vec::new();
    if tested("wheel_imbalance") {
        found.extend(imbalance(&mut runs, &mechanics));
    }
    if tested("vibration_alias") {
        found.extend(vibration(&runs));
    }
    found
}

/// The wheel whose turning shows in the gyro; what it explains is taken off the samples.
fn imbalance(runs: &mut [Fast<'_>], mechanics: &Mechanics) -> Option<Candidate> {
    let wheels = mechanics.model().wheels.len();
    let all_fits = |wheel: usize, order: f64| -> Vec<Fit> {
        runs.iter().flat_map(|fast| wheel_fits(fast, mechanics, wheel, order)).collect()
    };
    let found = (0..wheels).filter_map(|wheel| {
        let mut fits = all_fits(wheel, 1.0);
        if one_size(&fits)?.0 > LEAST_TOGETHER {
            // Where noise is louder than its high frequencies say, so is a rhythm that the wheel does not have.
            let beside: Vec<f64> =
                BESIDE.iter().flat_map(|order| all_fits(wheel, *order)).map(|f| f.drop).collect();
            let level = (0.5 * beside.iter().sum::<f64>() / beside.len().max(1) as f64).max(1.0);
            for fit in &mut fits {
                fit.drop /= level;
                fit.information /= level;
            }
        }
        let (evidence, size) = one_size(&fits)?;
        Some((evidence - (wheels as f64).ln(), size, wheel, fits))
    });
    let (evidence, size, wheel, fits) = found.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let drop = fits.iter().map(|f| f.drop).sum::<f64>() - 2.0 * fits.len() as f64;
    if evidence < LEAST_TOGETHER || drop < LEAST_DROP {
        return None;
    }
    let mut next = fits.iter();
    for fast in runs.iter_mut() {
        for stretch in stretches(fast) {
            let (Some(fit), signals) = (next.next(), wheel_signals(fast, mechanics, wheel, 1.0, stretch))
            else {
                break;
            };
            for (i, [a, b]) in signals.iter().enumerate() {
                for (at, (x, y)) in a.iter().zip(b).enumerate() {
                    if let Some(slot) = fast.channel[i].get_mut(stretch.0 + at) {
                        *slot -= fit.amplitude.x * x + fit.amplitude.y * y;
                    }
                }
            }
        }
    }
    let information: f64 = fits.iter().map(|f| f.information).sum();
    let name = mechanics.model().wheels.get(wheel).map_or(String::new(), |w| w.name.clone());
    let estimate = parameter(format!("{name}_kg_m2"), "kg m^2", size, (1.0 / information).sqrt());
    Some(row("wheel_imbalance", drop, evidence, vec![estimate]))
}

/// Log evidence and likeliest size of an imbalance that is the same in all stretches, its phase in each unknown: the
/// likelihood of a sine of known size and unknown phase in noise (Rice 1944), over sizes alike in their logarithm.
fn one_size(fits: &[Fit]) -> Option<(f64, f64)> {
    let information: f64 = fits.iter().map(|f| f.information).sum();
    let power: f64 = fits.iter().map(|f| f.drop).sum();
    if information <= 0.0 {
        return None;
    }
    let gain = |size: f64| -> f64 {
        fits.iter()
            .map(|f| {
                let expected = size * f.information.sqrt();
                log_bessel_0(expected * f.drop.max(0.0).sqrt()) - 0.5 * expected * expected
            })
            .sum()
    };
    // From what no data show to twice what would be all of the power; steps small against the likelihood's width.
    let largest = 2.0 * (power / information).sqrt().max(1.0 / information.sqrt());
    let smallest = 0.1 / information.sqrt();
    let steps = 400;
    let ratio = (largest / smallest).powf(1.0 / f64::from(steps));
    let gains: Vec<(f64, f64)> =
        (0..=steps).map(|i| smallest * ratio.powi(i)).map(|size| (gain(size), size)).collect();
    let best = gains.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let sum: f64 = gains.iter().map(|g| (g.0 - best.0).exp()).sum();
    let density = ratio.ln() / SIZES_OF_IMBALANCE.ln();
    Some((best.0 + (sum * density).ln(), best.1))
}

/// Logarithm of the modified Bessel function of order 0 (Abramowitz and Stegun 1964, 9.8.1 and 9.8.2).
fn log_bessel_0(x: f64) -> f64 {
    if x < 3.75 {
        let t = (x / 3.75).powi(2);
        let series = [0.004_581_3, 0.036_076_8, 0.265_973_2, 1.206_749_2, 3.089_942_4, 3.515_622_9, 1.0];
        return series.iter().fold(0.0, |sum, c| sum * t + c).ln();
    }
    let t = 3.75 / x;
    let series = [
        0.003_923_77,
        -0.016_476_33,
        0.026_355_37,
        -0.020_577_06,
        0.009_162_81,
        -0.001_575_65,
        0.002_253_19,
        0.013_285_92,
        0.398_942_28,
    ];
    x - 0.5 * x.ln() + series.iter().fold(0.0, |sum, c| sum * t + c).ln()
}

/// Both phases of a wheel's imbalance over one stretch.
struct Fit {
    drop: f64,
    amplitude: Vector2<f64>,
    /// Inverse variance of one amplitude.
    information: f64,
}

fn stretches(fast: &Fast<'_>) -> Vec<(usize, usize)> {
    let length = (COHERENT_S / fast.step_s) as usize;
    let count = (fast.len() as f64 / length.max(1) as f64).round().max(1.0) as usize;
    (0..count).map(|i| (i * fast.len() / count, (i + 1) * fast.len() / count)).collect()
}

/// What an imbalance of 1 kg m^2 adds to each gyro axis, at two phases a quarter turn apart; felt `order` times a turn.
fn wheel_signals(
    fast: &Fast<'_>,
    mechanics: &Mechanics,
    wheel: usize,
    order: f64,
    (from, to): (usize, usize),
) -> [[Vec<f64>; 2]; 3] {
    let mut signals: [[Vec<f64>; 2]; 3] =
        std::array::from_fn(|_| [vec![0.0; to - from], vec![0.0; to - from]]);
    let Some(w) = mechanics.model().wheels.get(wheel) else { return signals };
    let axis = w.spin_axis_b.into_inner();
    let helper = if axis.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
    let e1 = unit_or(axis.cross(&helper), Vector3::x_axis()).into_inner();
    let e2 = axis.cross(&e1);
    // The rate is the torque's integral over a turn: Om^2 becomes Om, a quarter turn later.
    let (u1, u2) = (mechanics.inverse_inertia * e1, mechanics.inverse_inertia * e2);
    for index in from..to {
        let t = fast.time(index);
        let k = fast.run.node_at(t);
        let (Some(angle), Some(s0), Some(s1)) = (
            fast.motion.wheel_angle.get(k),
            fast.motion.wheel.get(k),
            fast.motion.wheel.get(k + 1).or(fast.motion.wheel.get(k)),
        ) else {
            continue;
        };
        let (dt, h) = (t - fast.run.time(k), fast.run.length_or_zero(k).max(1e-6));
        let slope = (s1[wheel] - s0[wheel]) / h;
        let (speed, angle) = (s0[wheel] + slope * dt, angle[wheel] + s0[wheel] * dt + 0.5 * slope * dt * dt);
        let (s, c) = (order * angle).sin_cos();
        let first = (u1 * s - u2 * c) * speed;
        let second = (u1 * c + u2 * s) * speed;
        for i in 0..3 {
            signals[i][0][index - from] = first[i];
            signals[i][1][index - from] = second[i];
        }
    }
    for (i, pair) in signals.iter_mut().enumerate() {
        for signal in pair {
            fast_part(signal, &fast.there[0][from..to], fast.step_s);
            signal.iter_mut().for_each(|x| *x /= fast.stddev[i]);
        }
    }
    signals
}

fn wheel_fits(fast: &Fast<'_>, mechanics: &Mechanics, wheel: usize, order: f64) -> Vec<Fit> {
    stretches(fast)
        .into_iter()
        .map(|(from, to)| {
            let signals = wheel_signals(fast, mechanics, wheel, order, (from, to));
            let (mut matrix, mut vector) = (Matrix2::zeros(), Vector2::zeros());
            for (i, [a, b]) in signals.iter().enumerate() {
                for ((x, y), z) in a.iter().zip(b).zip(&fast.channel[i][from..to]) {
                    let g = Vector2::new(*x, *y);
                    matrix += g * g.transpose();
                    vector += g * *z;
                }
            }
            let amplitude = matrix.try_inverse().map_or_else(Vector2::zeros, |m| m * vector);
            Fit { drop: amplitude.dot(&vector), amplitude, information: 0.5 * matrix.trace() }
        })
        .collect()
}

/// What the samples of all runs hold of one frequency, in units of its noise: of each run both phases of each channel,
/// and of each channel how much one phase weighs.
struct Line {
    hz: f64,
    background: f64,
    of_run: Vec<[Complex<f64>; 6]>,
    weight: Vec<[f64; 6]>,
}

impl Line {
    fn new(runs: &[Fast<'_>], gates: &[Vec<f64>], hz: f64, background: f64) -> Self {
        let (mut of_run, mut weight) = (Vec::new(), Vec::new());
        for (fast, gate) in runs.iter().zip(gates) {
            let mut sums = [Complex::new(0.0, 0.0); 6];
            let mut counts = [0.0; 2];
            let step = Complex::from_polar(1.0, TAU * hz * fast.step_s);
            let mut wave = Complex::from_polar(1.0, TAU * hz * fast.start_s);
            for (index, g) in gate.iter().enumerate() {
                if *g > 0.0 {
                    for (sum, channel) in sums.iter_mut().zip(&fast.channel) {
                        *sum += wave * channel[index];
                    }
                    for (count, there) in counts.iter_mut().zip(&fast.there) {
                        *count += 0.5 * f64::from(u8::from(there[index]));
                    }
                }
                wave *= step;
            }
            let weights: [f64; 6] = std::array::from_fn(|c| counts[c / 3]);
            of_run.push(std::array::from_fn(|c| sums[c] / (2.0 * weights[c]).max(1.0).sqrt()));
            weight.push(weights);
        }
        Self { hz, background, of_run, weight }
    }

    /// Half the drop of the misfit by one vibration, and of each run its phase in it: the same motion of the sensors
    /// in every run, at a phase of its own. The largest eigenvalue of a matrix of correlations.
    fn one_motion(&self) -> (f64, Vec<Complex<f64>>) {
        let dot = |a: &[Complex<f64>; 6], b: &[Complex<f64>; 6]| -> Complex<f64> {
            a.iter().zip(b).map(|(x, y)| x.conj() * y).sum()
        };
        let loudest = self.of_run.iter().max_by(|a, b| dot(a, a).re.total_cmp(&dot(b, b).re));
        let Some(mut motion) = loudest.copied() else { return (0.0, Vec::new()) };
        let (mut power, mut phases) = (0.0, Vec::new());
        for _ in 0..MOST_TURNS {
            let norm = dot(&motion, &motion).re.sqrt().max(f64::MIN_POSITIVE);
            motion.iter_mut().for_each(|x| *x /= norm);
            phases = self.of_run.iter().map(|own| dot(&motion, own)).collect();
            let before = power;
            power = phases.iter().map(Complex::norm_sqr).sum();
            motion = std::array::from_fn(|c| {
                self.of_run.iter().zip(&phases).map(|(own, p)| own[c] * p.conj()).sum()
            });
            if power - before < 1e-6 * power {
                break;
            }
        }
        (power, phases)
    }

    /// Logarithm of the inverse chance that noise alone has so much of one motion at one frequency: the tail of the
    /// largest eigenvalue of a complex Wishart matrix, to leading order x^(n+m-2) e^-x / ((n-1)! (m-1)!).
    fn surprise(&self, power: f64) -> f64 {
        let factorial = |n: usize| (1..=n).map(|i| (i as f64).ln()).sum::<f64>();
        let (channels, runs) = (6, self.of_run.len().max(1));
        let dimensions = channels + runs - 2;
        let power = power.max(dimensions as f64);
        power - dimensions as f64 * power.ln() + factorial(channels - 1) + factorial(runs - 1)
    }
}

/// A line in gyro and accelerometer, always or only while valves are open.
fn vibration(runs: &[Fast<'_>]) -> Option<Candidate> {
    let first = runs.first()?;
    // Twice the length, so that no line falls between two frequencies.
    let size = runs.iter().map(Fast::len).max()?.next_power_of_two() * 2;
    let mut best: Option<(f64, f64, Line)> = None;
    for background in [1.0, 0.0] {
        let gates: Vec<Vec<f64>> = runs
            .iter()
            .map(|fast| if background > 0.0 { vec![1.0; fast.len()] } else { fast.valves() })
            .collect();
        let mut spectrum = Spectrum::new(size);
        for (fast, gate) in runs.iter().zip(&gates) {
            let open: f64 =
                gate.iter().zip(&fast.there[0]).filter(|(_, there)| **there).map(|(g, _)| g).sum();
            if open < 30.0 {
                continue;
            }
            let gated: Vec<Vec<f64>> =
                fast.channel.iter().map(|c| c.iter().zip(gate).map(|(x, g)| x * g).collect()).collect();
            spectrum.add_of(&gated, open, fast.step_s / first.step_s);
        }
        for peak in spectrum.peaks(first.step_s, SLOWEST_HZ) {
            // The best frequency near the peak.
            let spacing_hz = 1.0 / (size as f64 * first.step_s);
            for i in -4..=4 {
                let hz = peak.frequency + 0.25 * f64::from(i) * spacing_hz;
                let line = Line::new(runs, &gates, hz, background);
                let power = line.one_motion().0 / peak.level;
                let surprise = line.surprise(power);
                if best.as_ref().is_none_or(|b| surprise > b.0) {
                    best = Some((surprise, power, line));
                }
            }
        }
    }
    let (surprise, power, line) = best?;
    // Each of the frequencies, with valves open and always, might have been it.
    let evidence = surprise - (first.len() as f64).ln();
    let drop = 2.0 * (power - (5 + runs.len()) as f64);
    if evidence < LEAST_TOGETHER || drop < LEAST_DROP {
        return None;
    }
    let phases = line.one_motion().1;
    let names =
        ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", "accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"];
    let mut parameters: Vec<ParameterEstimate> = Vec::new();
    for (c, name) in names.iter().enumerate() {
        // The runs' readings turned to one phase.
        let (mut sum, mut information) = (Complex::new(0.0, 0.0), 0.0);
        for ((own, phase), weight) in line.of_run.iter().zip(&phases).zip(&line.weight) {
            sum += own[c] * (phase.conj() / phase.norm().max(f64::MIN_POSITIVE)) * (2.0 * weight[c]).sqrt();
            information += weight[c];
        }
        if information > 0.0 {
            let unit = if c < 3 { "rad/s" } else { "m/s^2" };
            let stddev = first.stddev[c] / information.sqrt();
            let amplitude = sum.norm() / information * first.stddev[c];
            parameters.push(parameter((*name).to_owned(), unit, amplitude, stddev));
        }
    }
    let length_s = first.len() as f64 * first.step_s;
    parameters.push(parameter("frequency_hz".to_owned(), "Hz", line.hz, 0.1 / length_s));
    parameters.push(parameter("background".to_owned(), "1", line.background, 0.5));
    Some(row("vibration_alias", drop, evidence, parameters))
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

    #[test]
    fn the_bessel_function_has_its_tabulated_values() {
        // Abramowitz and Stegun 1964, tables 9.8 and 9.11: I0(1), I0(5), e^-20 I0(20).
        for (x, expected) in [
            (1.0, 1.266_065_877_8_f64.ln()),
            (5.0, 27.239_871_823_6_f64.ln()),
            (20.0, 20.0 + 0.089_780_3_f64.ln()),
        ] {
            assert!((log_bessel_0(x) - expected).abs() < 1e-5, "{x}");
        }
    }

    /// Fits to noise and a sine of this size, in units of the noise of one phase.
    fn fits(size: f64, noise: &mut dyn FnMut() -> f64) -> Vec<Fit> {
        [1.0, 3.0, 0.3, 2.0, 5.0, 0.1]
            .into_iter()
            .map(|information: f64| {
                let turn = 3.0 * noise();
                let signal = size * information.sqrt();
                let (a, b) = (signal * turn.cos() + noise(), signal * turn.sin() + noise());
                let amplitude = Vector2::new(a, b) / information.sqrt();
                Fit { drop: a * a + b * b, amplitude, information }
            })
            .collect()
    }

    /// The mean of a Bayes factor over data without the effect is 1 (Turing), whatever the effect.
    #[test]
    fn evidence_of_an_imbalance_is_not_made_by_noise() {
        let mut random = Pcg64::new(9, 1);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let count = 3000;
        let mean = (0..count).map(|_| one_size(&fits(0.0, &mut noise)).unwrap().0.exp()).sum::<f64>()
            / f64::from(count);
        assert!((0.05..1.3).contains(&mean), "{mean}");
        let (evidence, size) = one_size(&fits(3.0, &mut noise)).unwrap();
        assert!(evidence > 20.0 && (size - 3.0).abs() < 1.0, "{evidence} {size}");
    }

    #[test]
    fn noise_has_so_much_of_one_motion_as_seldom_as_is_said() {
        let mut random = Pcg64::new(5, 3);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let count = 30_000;
        let surprising = (0..count)
            .filter(|_| {
                let mut one = || Complex::new(noise(), noise()) * 0.5_f64.sqrt();
                let of_run: Vec<[Complex<f64>; 6]> = (0..3).map(|_| std::array::from_fn(|_| one())).collect();
                let line = Line { hz: 10.0, background: 1.0, of_run, weight: vec![[1.0; 6]; 3] };
                line.surprise(line.one_motion().0) > 300f64.ln()
            })
            .count();
        // One in 300, to leading order.
        assert!((50..200).contains(&surprising), "{surprising}");
    }
}
