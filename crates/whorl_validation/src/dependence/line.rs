//! A periodic torque: a line in the spectrum.

use serde::Serialize;
use whorl_math::spectrum::Fourier;

use super::{Frame, Residual};

/// Minimum share of an axis' power for a line to be reported.
const LEAST_SHARE: f64 = 0.25;
/// Share of the mean square on the largest axis below which a line is of no consequence.
const OF_CONSEQUENCE: f64 = 0.1;
/// Probability that noise alone shows a line this strong.
const FALSE_ALARM: f64 = 1e-3;

/// An oscillation of the residual torque.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpectralLine {
    /// Frequency \[Hz\].
    pub frequency_hz: f64,
    /// Amplitude [N m].
    pub amplitude_n_m: f64,
    /// The frame in which it is strongest.
    pub frame: Frame,
    /// The axis: 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Share of that axis' power about its mean.
    pub share: f64,
}

/// The strongest line of a residual sampled at (nearly) equal times, if Fisher's test (R. A. Fisher, Tests
/// of significance in harmonic analysis, Proc. R. Soc. A 125, 1929) shows that it is significant.
/// The lowest two frequencies are left out: they are trends.
#[must_use]
pub fn spectral_line(residual: &Residual) -> Option<SpectralLine> {
    let n = residual.time_s.len();
    let (first, last) = (*residual.time_s.first()?, *residual.time_s.last()?);
    if n < super::FEWEST_VALUES || last <= first {
        return None;
    }
    let length_s = (last - first) * n as f64 / (n - 1) as f64;
    let fourier = Fourier::of_length(n);
    let mean_square = |axis: &Vec<(f64, f64)>| axis.iter().map(|(x, _)| x * x).sum::<f64>() / n as f64;
    let largest = residual.frames().flat_map(|(_, axes)| axes).map(mean_square).fold(0.0, f64::max);
    let mut best: Option<SpectralLine> = None;
    for (frame, axes) in residual.frames() {
        // Of an axis about which nothing can turn there is rounding.
        let turns = |values: &Vec<(f64, f64)>| values.iter().any(|(_, sigma)| sigma.is_finite());
        for (axis, values) in axes.iter().enumerate().filter(|(_, values)| turns(values)) {
            let mean = values.iter().map(|(x, _)| x).sum::<f64>() / n as f64;
            let power: f64 = values.iter().map(|(x, _)| (x - mean).powi(2)).sum::<f64>() / n as f64;
            let spectrum = fourier.transform(values.iter().map(|(x, _)| x - mean));
            // The number of frequencies is limited: lines of interest lie well below the sampling rate.
            let highest = (n / 2).min(4000);
            for (k, x) in spectrum.iter().enumerate().take(highest).skip(3) {
                let frequency_hz = k as f64 / length_s;
                let amplitude = 2.0 * x.norm() / n as f64;
                let share = 0.5 * amplitude * amplitude / power.max(f64::MIN_POSITIVE);
                let matters = 0.5 * amplitude * amplitude > OF_CONSEQUENCE * largest;
                if matters
                    && share > LEAST_SHARE
                    && best.is_none_or(|b| share > b.share)
                    && is_significant(share, n / 2)
                {
                    best = Some(SpectralLine { frequency_hz, amplitude_n_m: amplitude, frame, axis, share });
                }
            }
        }
    }
    best
}

/// Fisher's g against its critical value: P(g > x) < m (1 - x)^(m - 1).
fn is_significant(share: f64, frequencies: usize) -> bool {
    let m = frequencies as f64;
    m * (1.0 - share.min(1.0)).powf(m - 1.0) < FALSE_ALARM
}
