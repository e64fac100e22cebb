//! Power spectra, and the peaks that stand out of them.

use whorl_math::spectrum::Fourier;
use whorl_math::statistics::median;

/// Standard deviations from which on a peak is a line at all.
const NOTICED: f64 = 3.5;

/// A peak of a spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Peak {
    /// Cycles per unit of the axis.
    pub frequency: f64,
    /// Standard deviations above what is around it.
    pub significance: f64,
    /// Power around it, over that of the noise; at least 1.
    pub level: f64,
}

/// Standard deviations of the normal law with the same tail as a sum of `degrees` exponential variates
/// (Wilson and Hilferty 1931).
pub(crate) fn gamma_significance(sum: f64, degrees: f64) -> f64 {
    let spread = 1.0 / (9.0 * degrees);
    ((sum / degrees).max(0.0).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Sum of the power spectra of series of unit variance.
pub(crate) struct Spectrum {
    size: usize,
    fourier: Fourier,
    power: Vec<f64>,
    series: f64,
}

impl Spectrum {
    /// For series of at most `size` entries.
    pub fn new(size: usize) -> Self {
        Self { size, fourier: Fourier::of_length(size), power: vec![0.0; size / 2], series: 0.0 }
    }

    /// Adds series whose steps are `stretch` times those of the first.
    pub fn add(&mut self, list: &[Vec<f64>], stretch: f64) {
        let length = list.first().map_or(0, Vec::len);
        self.add_of(list, length as f64, stretch);
    }

    /// As [`Self::add`], with the sum of the variances of each series' entries.
    pub fn add_of(&mut self, list: &[Vec<f64>], variance: f64, stretch: f64) {
        // An axis that no sensor watches has no spectrum.
        for series in list.iter().filter(|series| series.iter().any(|x| *x != 0.0)) {
            let power = self.fourier.power(series.iter().copied());
            for (m, power) in power.into_iter().enumerate().take(self.size / 2) {
                let at = (m as f64 / stretch).round() as usize;
                if let Some(slot) = self.power.get_mut(at) {
                    *slot += power / variance.max(1.0);
                }
            }
            self.series += 1.0;
        }
    }

    /// Peaks that stand out of the spectrum beside them, from frequency `from` on.
    pub fn peaks(&self, step: f64, from: f64) -> Vec<Peak> {
        let power = &self.power;
        let mut peaks = Vec::new();
        if self.series < 1.0 {
            return peaks;
        }
        let degrees = self.series;
        let first = ((from * self.size as f64 * step).ceil() as usize).max(2);
        for m in first..power.len().saturating_sub(2) {
            let here = power[m];
            if here < power[m - 1] || here < power[m + 1] || here < 1.5 * degrees {
                continue;
            }
            let (low, high) = (m.saturating_sub(40).max(1), (m + 41).min(power.len()));
            let median = median(power[low..high].iter().copied());
            // Noise alone: a sum of exponential variates of mean 1. A louder spectrum on both sides counts as noise.
            let level = (median / (degrees - 1.0 / 3.0)).max(1.0);
            let significance = gamma_significance(here / level, degrees);
            if significance < NOTICED {
                continue;
            }
            // Between two bins the line is where their amplitudes balance.
            let (left, right) = (power[m - 1].sqrt(), power[m + 1].sqrt());
            let shift =
                if right > left { right / (right + here.sqrt()) } else { -left / (left + here.sqrt()) };
            // Padded to twice the length or more, the peak is wider than a bin.
            peaks.push(Peak {
                frequency: (m as f64 + 0.5 * shift) / (self.size as f64 * step),
                significance,
                level,
            });
        }
        peaks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_in_noise_has_one_line() {
        let mut state = 4_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 12f64.sqrt()
        };
        let step_s = 0.02;
        let series: Vec<f64> = (0..4000)
            .map(|k| 0.25 * (std::f64::consts::TAU * 3.217 * f64::from(k) * step_s).sin() + noise())
            .collect();
        let certain = crate::Settings::default().certain_stddevs;
        let mut spectrum = Spectrum::new(8192);
        spectrum.add(&[series], 1.0);
        let mut peaks = spectrum.peaks(step_s, 0.0);
        peaks.sort_by(|a, b| b.significance.total_cmp(&a.significance));
        assert!(peaks[0].significance > certain, "{peaks:?}");
        assert!((peaks[0].frequency - 3.217).abs() < 3e-3, "{peaks:?}");
        assert!(peaks.iter().skip(1).all(|p| p.significance < certain), "{peaks:?}");
    }

    #[test]
    fn the_tail_of_a_sum_of_exponentials_is_that_of_the_normal_law() {
        // P(sum of one exponential > x) = exp(-x): 2.33 and 3.09 standard deviations are 1e-2 and 1e-3.
        assert!((gamma_significance(100f64.ln(), 1.0) - 2.326).abs() < 0.05);
        assert!((gamma_significance(1000f64.ln(), 1.0) - 3.090).abs() < 0.08);
    }
}
