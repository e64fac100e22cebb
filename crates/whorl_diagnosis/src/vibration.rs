//! Lines too fast for the bins of the regression: vibration of the sensors, unbalanced wheels.
//!
//! Far above the platform's own motion the gyro's and the accelerometer's samples are noise plus what shakes
//! the sensors, so a slow mean taken off the samples is all the model that is needed.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Vector2, Vector3};

use whorl_math::unit_or;

use crate::bins::median_step_s;
use crate::columns::predict;
use crate::diagnosis::{Candidate, ParameterEstimate};
use crate::mechanics::Mechanics;
use crate::motion::Motion;
use crate::run::Run;
use crate::search::{LEAST_DROP, Search, point_of};
use crate::spectrum::{CERTAIN, Spectrum, gamma_significance};

/// The mean over this much on both sides is taken off every sample \[s\].
const HALF_WINDOW_S: f64 = 0.15;

/// Slower lines belong to the regression \[Hz\].
const SLOWEST_HZ: f64 = 4.0;

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
        let start_s = *run.raw_gyro.time_s.first()?;
        let step_s = median_step_s(&run.raw_gyro.time_s).max(1e-4);
        let last_s = *run.raw_gyro.time_s.last()?;
        let count = ((last_s - start_s) / step_s).round() as usize + 1;
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

fn row(effect: &str, drop: f64, choices: f64, parameters: Vec<ParameterEstimate>) -> Candidate {
    let evidence = 0.5 * drop - choices;
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
    let mut best: Option<(f64, f64, usize, Vec<Fit>)> = None;
    for wheel in 0..wheels {
        let fits: Vec<Fit> = runs.iter().flat_map(|fast| wheel_fits(fast, mechanics, wheel)).collect();
        let drop: f64 = fits.iter().map(|f| f.drop).sum();
        if fits.is_empty() {
            continue;
        }
        // Half the drop of each stretch is an exponential variate where there is noise alone.
        let significance = gamma_significance(0.5 * drop, fits.len() as f64);
        if best.as_ref().is_none_or(|b| significance > b.0) {
            best = Some((significance, drop, wheel, fits));
        }
    }
    let (significance, drop, wheel, fits) = best?;
    let dropped = drop - 2.0 * fits.len() as f64;
    if significance < CERTAIN || dropped < LEAST_DROP {
        return None;
    }
    let mut next = fits.iter();
    for fast in runs.iter_mut() {
        for stretch in stretches(fast) {
            let (Some(fit), signals) = (next.next(), wheel_signals(fast, mechanics, wheel, stretch)) else {
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
    let weight: f64 = fits.iter().map(|f| f.information).sum();
    let power: f64 = fits.iter().map(|f| f.information * f.amplitude.norm_squared()).sum::<f64>() / weight;
    let stddev = (1.0 / weight).sqrt();
    let size = (power - 2.0 * stddev * stddev * fits.len() as f64).max(0.0).sqrt();
    let name = mechanics.model().wheels.get(wheel).map_or(String::new(), |w| w.name.clone());
    let estimate = parameter(format!("{name}_kg_m2"), "kg m^2", size, stddev);
    Some(row("wheel_imbalance", dropped, (wheels as f64).ln() + fits.len() as f64, vec![estimate]))
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

/// What an imbalance of 1 kg m^2 adds to each gyro axis, at two phases a quarter turn apart.
fn wheel_signals(
    fast: &Fast<'_>,
    mechanics: &Mechanics,
    wheel: usize,
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
        let (s, c) = angle.sin_cos();
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

fn wheel_fits(fast: &Fast<'_>, mechanics: &Mechanics, wheel: usize) -> Vec<Fit> {
    stretches(fast)
        .into_iter()
        .map(|(from, to)| {
            let signals = wheel_signals(fast, mechanics, wheel, (from, to));
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

/// A line in gyro and accelerometer, always or only while valves are open.
fn vibration(runs: &[Fast<'_>]) -> Option<Candidate> {
    let first = runs.first()?;
    let size = runs.iter().map(Fast::len).max()?.next_power_of_two();
    let mut best: Option<(f64, f64, f64)> = None;
    for background in [1.0, 0.0] {
        let mut spectrum = Spectrum::new(size);
        for fast in runs {
            let gate = if background > 0.0 { vec![1.0; fast.len()] } else { fast.valves() };
            let open: f64 =
                gate.iter().zip(&fast.there[0]).filter(|(_, there)| **there).map(|(g, _)| g).sum();
            if open < 30.0 {
                continue;
            }
            let gated: Vec<Vec<f64>> =
                fast.channel.iter().map(|c| c.iter().zip(&gate).map(|(x, g)| x * g).collect()).collect();
            spectrum.add_of(&gated, open, fast.step_s / first.step_s);
        }
        for peak in spectrum.peaks(first.step_s, SLOWEST_HZ) {
            if best.is_none_or(|b| peak.significance > b.0) {
                best = Some((peak.significance, peak.frequency, background));
            }
        }
    }
    let (significance, hz, background) = best.filter(|b| b.0 > CERTAIN)?;
    let _ = significance;
    // Amplitude and drop of each channel at the line, the phase free in each run.
    let mut drop = 0.0;
    let mut amplitude = [0.0; 6];
    let mut information = [0.0; 6];
    for fast in runs {
        let gate = if background > 0.0 { vec![1.0; fast.len()] } else { fast.valves() };
        for c in 0..6 {
            let (mut re, mut im, mut weight) = (0.0, 0.0, 0.0);
            for (index, (x, g)) in fast.channel[c].iter().zip(&gate).enumerate() {
                if *g > 0.0 && fast.there[c / 3][index] {
                    let (s, cosine) = (TAU * hz * fast.time(index)).sin_cos();
                    re += x * cosine;
                    im += x * s;
                    weight += 0.5;
                }
            }
            if weight > 0.0 {
                drop += (re * re + im * im) / weight;
                amplitude[c] += re.hypot(im) * fast.stddev[c];
                information[c] += weight;
            }
        }
    }
    let degrees = 2.0 * 6.0 * runs.len() as f64;
    if drop - degrees < LEAST_DROP {
        return None;
    }
    let names =
        ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s", "accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"];
    let mut parameters: Vec<ParameterEstimate> = names
        .iter()
        .enumerate()
        .filter(|(c, _)| information[*c] > 0.0)
        .map(|(c, name)| {
            let unit = if c < 3 { "rad/s" } else { "m/s^2" };
            let stddev = first.stddev[c] / information[c].sqrt();
            parameter((*name).to_owned(), unit, amplitude[c] / information[c], stddev)
        })
        .collect();
    let length_s = first.len() as f64 * first.step_s;
    parameters.push(parameter("frequency_hz".to_owned(), "Hz", hz, 0.1 / length_s));
    parameters.push(parameter("background".to_owned(), "1", background, 0.5));
    Some(row("vibration_alias", drop - degrees, (size as f64).ln() + 0.5 * degrees, parameters))
}
