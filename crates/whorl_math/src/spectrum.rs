//! Fourier transforms of real series, and lines in their spectra.

use std::sync::Arc;

use nalgebra::{Complex, Matrix6, SymmetricEigen, Vector6};
use realfft::{RealFftPlanner, RealToComplex};

use crate::statistics::median;

/// Standard deviations from which on a peak is a line at all.
const NOTICED: f64 = 3.5;
/// Bins to each side of a peak whose median is the noise there.
const BESIDE: usize = 40;

/// The discrete Fourier transform of real series of one length, planned once.
///
/// ```text
/// X_m = sum_k x_k exp(-2 pi i m k / n),   m = 0 ... n / 2
/// ```
pub struct Fourier {
    plan: Arc<dyn RealToComplex<f64>>,
}

impl Fourier {
    /// A transform for series of `length` values. Where the end of a series must not wrap around to its beginning,
    /// use twice the next power of two.
    #[must_use]
    pub fn of_length(length: usize) -> Self {
        Self { plan: RealFftPlanner::new().plan_fft_forward(length.max(1)) }
    }

    /// The transform at the frequencies 0, 1/n, ... up to half a cycle per sample (n / 2 + 1 of them) of the values,
    /// zero-padded to the length n; further values are ignored.
    pub fn transform(&self, values: impl IntoIterator<Item = f64>) -> Vec<Complex<f64>> {
        let (mut input, mut output) = (self.plan.make_input_vec(), self.plan.make_output_vec());
        for (slot, value) in input.iter_mut().zip(values) {
            *slot = value;
        }
        #[expect(
            clippy::expect_used,
            reason = "it fails for wrong lengths only, and the plan made both vectors"
        )]
        self.plan.process(&mut input, &mut output).expect("vectors of the plan's own lengths");
        output
    }

    /// Squared magnitudes of [`Self::transform`].
    pub fn power(&self, values: impl IntoIterator<Item = f64>) -> Vec<f64> {
        self.transform(values).iter().map(Complex::norm_sqr).collect()
    }
}

/// Standard deviations of the normal law with the same tail as a sum of `degrees` exponential variates
/// (Wilson and Hilferty 1931).
#[must_use]
pub fn gamma_significance(sum: f64, degrees: f64) -> f64 {
    let spread = 1.0 / (9.0 * degrees);
    ((sum / degrees).max(0.0).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Series of unit variance on one grid, a part of what a spectrum is made of.
#[derive(Debug, Clone, Default)]
pub struct Gridded {
    /// The series; one of zeros takes no part.
    pub series: Vec<Vec<f64>>,
    /// Sum of the variances of a series' entries: as many as there are, less those that are lost.
    pub variance: f64,
    /// Its step over that of the first part.
    pub stretch: f64,
}

/// A peak of a spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Cycles per unit of the axis.
    pub frequency: f64,
    /// Standard deviations above what is around it.
    pub significance: f64,
    /// Power around it, over that of the noise; at least 1.
    pub level: f64,
}

/// Peaks that stand out of the sum of the power spectra of all series beside them, from frequency `from` on; `step`: that of the first
/// part. Zero-padded to twice the length, so that no line falls between two bins.
#[must_use]
pub fn peaks(parts: &[Gridded], step: f64, from: f64) -> Vec<Peak> {
    let length = parts.iter().flat_map(|part| &part.series).map(Vec::len).max().unwrap_or(0);
    let size = 2 * length.next_power_of_two();
    let fourier = Fourier::of_length(size);
    let mut power = vec![0.0; size / 2];
    let mut degrees = 0.0;
    for part in parts {
        for series in part.series.iter().filter(|series| series.iter().any(|x| *x != 0.0)) {
            for (m, of_series) in fourier.power(series.iter().copied()).into_iter().take(size / 2).enumerate()
            {
                let at = (m as f64 / part.stretch).round() as usize;
                if let Some(slot) = power.get_mut(at) {
                    *slot += of_series / part.variance.max(1.0);
                }
            }
            degrees += 1.0;
        }
    }
    let first = ((from * size as f64 * step).ceil() as usize).max(2);
    let peak = |m: usize| {
        let [left, here, right] = [power[m - 1], power[m], power[m + 1]];
        if degrees < 1.0 || here < left || here < right || here < 1.5 * degrees {
            return None;
        }
        let beside = &power[m.saturating_sub(BESIDE).max(1)..(m + BESIDE + 1).min(power.len())];
        // Noise alone: a sum of exponential variates of mean 1. A louder spectrum on both sides counts as noise.
        let level = (median(beside.iter().copied()) / (degrees - 1.0 / 3.0)).max(1.0);
        let significance = gamma_significance(here / level, degrees);
        // Between two bins the line is where their amplitudes balance.
        let (left, here, right) = (left.sqrt(), here.sqrt(), right.sqrt());
        let shift = if right > left { right / (right + here) } else { -left / (left + here) };
        // Padded to twice the length or more, the peak is wider than a bin.
        let frequency = (m as f64 + 0.5 * shift) / (size as f64 * step);
        (significance >= NOTICED).then_some(Peak { frequency, significance, level })
    };
    (first..power.len().saturating_sub(2)).filter_map(peak).collect()
}

/// Half the drop of the misfit by one motion that three rates and three accelerations share at one frequency in every run, each in units of
/// its noise, and of each run its phase and size in it: the largest eigenvalue of a matrix of correlations.
#[must_use]
pub fn common_motion(of_runs: &[Vector6<Complex<f64>>]) -> (f64, Vec<Complex<f64>>) {
    let correlations: Matrix6<Complex<f64>> = of_runs.iter().map(|held| held * held.adjoint()).sum();
    let eigen = SymmetricEigen::new(correlations);
    let largest = eigen.eigenvalues.imax();
    let motion = eigen.eigenvectors.column(largest);
    (eigen.eigenvalues[largest], of_runs.iter().map(|held| motion.dotc(held)).collect())
}

/// Logarithm of the inverse chance that noise alone has so much of one motion of six channels in some runs: the tail of the
/// largest eigenvalue of a complex Wishart matrix, to leading order x^(n+m-2) e^-x / ((n-1)! (m-1)!).
#[must_use]
pub fn surprise_of_motion(power: f64, runs: usize) -> f64 {
    let log_factorial = |n: usize| (1..=n).map(|i| (i as f64).ln()).sum::<f64>();
    let runs = runs.max(1);
    let dimensions = (6 + runs - 2) as f64;
    let power = power.max(dimensions);
    power - dimensions * power.ln() + log_factorial(5) + log_factorial(runs - 1)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn a_sine_in_noise_has_one_line() {
        let mut state = 4_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 12f64.sqrt()
        };
        let step_s = 0.02;
        let series: Vec<f64> =
            (0..4000).map(|k| 0.25 * (TAU * 3.217 * f64::from(k) * step_s).sin() + noise()).collect();
        let part = Gridded { variance: series.len() as f64, series: vec![series], stretch: 1.0 };
        let mut peaks = peaks(&[part], step_s, 0.0);
        peaks.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        assert!(peaks[0].significance > 5.5, "{peaks:?}");
        assert!((peaks[0].frequency - 3.217).abs() < 3e-3, "{peaks:?}");
        assert!(peaks.iter().skip(1).all(|p| p.significance < 5.5), "{peaks:?}");
    }

    #[test]
    fn the_tail_of_a_sum_of_exponentials_is_that_of_the_normal_law() {
        // P(sum of one exponential > x) = exp(-x): 2.33 and 3.09 standard deviations are 1e-2 and 1e-3.
        assert!((gamma_significance(100f64.ln(), 1.0) - 2.326).abs() < 0.05);
        assert!((gamma_significance(1000f64.ln(), 1.0) - 3.090).abs() < 0.08);
    }

    #[test]
    fn it_agrees_with_the_definition_for_any_length_and_padding() {
        for (count, length) in [(32, 32), (30, 30), (31, 31), (20, 32), (40, 32)] {
            let values: Vec<f64> = (0..count).map(|k| f64::from(k * k % 7) - 0.3 * f64::from(k)).collect();
            let found = Fourier::of_length(length).transform(values.iter().copied());
            assert_eq!(found.len(), length / 2 + 1);
            for (m, x) in found.iter().enumerate() {
                let sum = |f: fn(f64) -> f64| -> f64 {
                    let phase = |t: usize| TAU * (m * t) as f64 / length as f64;
                    values.iter().take(length).enumerate().map(|(t, v)| v * f(phase(t))).sum()
                };
                let (re, im) = (sum(f64::cos), -sum(f64::sin));
                assert!((x.re - re).abs() < 1e-9 && (x.im - im).abs() < 1e-9, "{length} {m}: {x} {re} {im}");
            }
            let power = Fourier::of_length(length).power(values);
            assert!(power.iter().zip(&found).all(|(p, x)| (p - x.norm_sqr()).abs() < 1e-9));
        }
    }
}
