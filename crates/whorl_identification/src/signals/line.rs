//! Vibration of the sensors: one frequency in all runs.

use std::f64::consts::TAU;

use nalgebra::Complex;
use whorl_dynamics::Effect;

use super::fast::{Fast, parameter, row};
use super::spectrum::Spectrum;
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Turns of the iteration that finds one motion of the sensors in all runs.
const MOST_TURNS: usize = 60;

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

/// Names of the parameters that a vibration has in its effect.
pub(super) struct Names {
    /// Amplitude in each axis of the gyro, then of the accelerometer.
    pub amplitude: [&'static str; 6],
    pub frequency: &'static str,
    pub background: &'static str,
}

/// A line in gyro and accelerometer, always or only while valves are open.
pub(super) fn vibration(runs: &[Fast<'_>], effect: &dyn Effect, names: &Names) -> Option<Candidate> {
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
        for peak in spectrum.peaks(first.step_s, first.settings.slowest_vibration_hz) {
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
    if evidence < first.settings.window_nats || drop < first.settings.clear_misfit {
        return None;
    }
    let phases = line.one_motion().1;
    let mut parameters: Vec<ParameterEstimate> = Vec::new();
    for (c, name) in names.amplitude.iter().enumerate() {
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
    parameters.push(parameter(names.frequency.to_owned(), "Hz", line.hz, 0.1 / length_s));
    parameters.push(parameter(names.background.to_owned(), "1", line.background, 0.5));
    Some(row(effect, drop, evidence, parameters))
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

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
