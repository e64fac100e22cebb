//! Fourier transforms of real series.

use std::sync::Arc;

use nalgebra::Complex;
use realfft::{RealFftPlanner, RealToComplex};

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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::Fourier;

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
