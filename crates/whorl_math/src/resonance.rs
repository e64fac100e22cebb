//! Resonances that a known motion drives, found in what a model without them leaves.
//!
//! A lightly damped mode responds only near its own frequency, and a grid of a few frequencies misses it. Its
//! response is known except for frequency and damping: a second-order filter of the acceleration that drives it. So what is left
//! is correlated with that response at every frequency that the runs resolve, in the frequency domain, where each mode touches few bins. Phase and
//! shape of the drive count, so that a mode is seen long before its line stands out of the spectrum.

use std::f64::consts::{LN_2, PI, TAU};

use nalgebra::{Complex, Matrix3, Vector3};

use crate::spectrum::{Fourier, gamma_significance};
use crate::statistics::median;

/// Damping ratios that are tried: a boom or a liquid's free surface, and a liquid with baffles.
const DAMPING: [f64; 3] = [0.004, 0.012, 0.04];
/// Bins to each side of a band whose median is the noise there.
const BESIDE: usize = 40;

/// Spectra of one run.
#[derive(Debug, Clone)]
pub struct Driven {
    /// What is left of the rate about each axis, in standard deviations.
    left: [Vec<Complex<f64>>; 3],
    /// Acceleration about each axis.
    drive: [Vec<Complex<f64>>; 3],
    /// Between bins \[Hz\].
    spacing_hz: f64,
    length_s: f64,
}

impl Driven {
    /// What is left of the rates about three axes, in standard deviations, a sample every `step_s`; and the rates themselves [rad/s] at
    /// the ends of these steps, one more.
    #[must_use]
    pub fn new(left: [&[f64]; 3], rates: &[Vector3<f64>], step_s: f64) -> Self {
        let count = left[0].len();
        // Twice the length, so that what rings on at the end does not come back at the start.
        let size = count.next_power_of_two() * 2;
        let fourier = Fourier::of_length(size);
        let spectrum = |series: &mut dyn Iterator<Item = f64>| {
            let mut found = fourier.transform(series);
            found.truncate(size / 2);
            found
        };
        let drive = |i: usize| {
            let mut drive = spectrum(&mut rates.windows(2).map(|pair| (pair[1] - pair[0])[i] / step_s));
            // An interval's acceleration belongs to its middle.
            for (m, x) in drive.iter_mut().enumerate() {
                *x *= Complex::from_polar(1.0, -PI * m as f64 / size as f64);
            }
            drive
        };
        Self {
            left: left.map(|series| spectrum(&mut series.iter().copied())),
            drive: [0, 1, 2].map(drive),
            spacing_hz: 1.0 / (size as f64 * step_s),
            length_s: step_s * count as f64,
        }
    }

    /// Bins of a band, and the power of what is left beside it about each axis, over that of white noise; 1 at least.
    fn band(&self, hz: f64, damping_ratio: f64, slowest_hz: f64) -> (std::ops::Range<usize>, [f64; 3]) {
        let bins = self.left[0].len();
        let half_hz = 12.0 * damping_ratio * hz + 3.0 / self.length_s;
        let to = (((hz + half_hz) / self.spacing_hz) as usize + 1).min(bins);
        let from = (((hz - half_hz).max(0.3 * slowest_hz) / self.spacing_hz) as usize).min(to);
        let (low, high) = (from.saturating_sub(BESIDE), (to + BESIDE).min(bins));
        // Of white noise each bin has an exponential power whose median is that share of its mean.
        let samples = (self.length_s * self.spacing_hz * 2.0 * bins as f64).max(1.0);
        let level = |i: usize| median(self.left[i][low..high].iter().map(Complex::norm_sqr));
        (from..to, [0, 1, 2].map(|i| (level(i) / (LN_2 * samples)).max(1.0)))
    }
}

/// A mode that the runs may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ringing {
    /// Its frequency \[Hz\].
    pub hz: f64,
    /// Its damping over the critical one.
    pub damping_ratio: f64,
    /// Rate about the first axis, in standard deviations, by an acceleration about the second.
    pub coupling: Matrix3<f64>,
    /// Standard deviations by which it stands out.
    pub significance: f64,
}

/// Modes between two frequencies that stand out by so many deviations, each beside its neighbours on the grid.
#[must_use]
pub fn ringing(runs: &[Driven], slowest_hz: f64, fastest_hz: f64, least_significance: f64) -> Vec<Ringing> {
    let longest_s = runs.iter().map(|run| run.length_s).fold(0.0, f64::max);
    let mut found = Vec::new();
    for damping_ratio in DAMPING.into_iter().filter(|_| longest_s > 0.0) {
        let mut next_hz = slowest_hz;
        while next_hz < fastest_hz {
            let hz = next_hz;
            next_hz += (0.3 / longest_s).max(0.7 * damping_ratio * hz);
            let (with, gram) = correlate(runs, hz, damping_ratio, slowest_hz);
            let Some(inverse) = gram.try_inverse() else { continue };
            let explained: f64 = with.iter().map(|c| c.dot(&(inverse * c))).sum();
            // Nine correlations of noise alone: half their squares are the sum of 4.5 exponential variates.
            let significance = gamma_significance(0.5 * explained, 4.5);
            if significance >= least_significance {
                let coupling = Matrix3::from_rows(&with.map(|c| (inverse * c).transpose()));
                found.push(Ringing { hz, damping_ratio, coupling, significance });
            }
        }
    }
    found
}

/// Correlations of what is left with the answers of a mode, and the answers' own.
fn correlate(
    runs: &[Driven],
    hz: f64,
    damping_ratio: f64,
    slowest_hz: f64,
) -> ([Vector3<f64>; 3], Matrix3<f64>) {
    let mut with = [Vector3::zeros(); 3];
    let mut gram = Matrix3::zeros();
    let w = TAU * hz;
    for run in runs {
        // Parseval: a sum over bins of one sign is so many times the sum over time.
        let weight = 1.0 / run.left[0].len() as f64;
        let (band, levels) = run.band(hz, damping_ratio, slowest_hz);
        for m in band {
            let s = Complex::new(0.0, TAU * m as f64 * run.spacing_hz);
            let filter = s / (s * s + s * (2.0 * damping_ratio * w) + w * w);
            let answer = [0, 1, 2].map(|j| filter * run.drive[j][m]);
            for i in 0..3 {
                for j in 0..3 {
                    with[i][j] += weight * (run.left[i][m].conj() * answer[j]).re / levels[i].sqrt();
                    gram[(i, j)] += weight * (answer[i].conj() * answer[j]).re;
                }
            }
        }
    }
    (with, gram)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White noise of unit variance: sums of twelve numbers of a linear congruential generator (Knuth's MMIX).
    fn noise(count: usize) -> Vec<f64> {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..count).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
    }

    /// An oscillator about the first axis, integrated here, driven by a motion about the second whose frequency rises from 0.2 to 5 Hz.
    #[test]
    fn a_mode_that_the_motion_drives_is_found_at_its_frequency_and_none_in_noise() {
        let (step_s, w, damping) = (0.02, TAU * 1.7, 0.012);
        let wave = |k: usize, hz: f64| (TAU * hz * step_s * k as f64).sin();
        let rising = |k: usize| {
            let t = step_s * k as f64;
            0.1 * (TAU * (0.2 * t + 0.02 * t * t)).sin()
        };
        // Motion about the others keeps the answers apart.
        let rates: Vec<Vector3<f64>> =
            (0..=6000).map(|k| Vector3::new(0.05 * wave(k, 0.7), rising(k), 0.05 * wave(k, 2.3))).collect();
        let (mut position, mut speed) = (0.0, 0.0);
        let answer: Vec<f64> = rates
            .windows(2)
            .map(|pair| {
                for _ in 0..10 {
                    let drive = (pair[1].y - pair[0].y) / step_s;
                    speed += 0.1 * step_s * (drive - 2.0 * damping * w * speed - w * w * position);
                    position += 0.1 * step_s * speed;
                }
                2.0 * speed
            })
            .collect();
        let white = noise(3 * answer.len());
        let (x, rest) = white.split_at(answer.len());
        let (y, z) = rest.split_at(answer.len());
        let with: Vec<f64> = answer.iter().zip(x).map(|(a, b)| a + b).collect();
        let found = |left: &[f64]| ringing(&[Driven::new([left, y, z], &rates, step_s)], 0.15, 10.0, 5.5);
        assert_eq!(found(x), []);
        let all = found(&with);
        let best = all.iter().max_by(|a, b| a.significance.total_cmp(&b.significance)).unwrap();
        assert!((best.hz - 1.7).abs() < 0.05, "{best:?}");
        let coupling = best.coupling[(0, 1)];
        assert!((coupling - 2.0).abs() < 0.5 && coupling > 3.0 * best.coupling[(1, 1)].abs(), "{best:?}");
    }
}
