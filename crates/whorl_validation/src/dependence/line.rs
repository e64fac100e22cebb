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
    // Of an axis about which nothing can turn there is rounding.
    let turns =
        |(.., values): &(Frame, usize, &Vec<(f64, f64)>)| values.iter().any(|(_, sigma)| sigma.is_finite());
    let axes = residual.frames().flat_map(|(frame, axes)| (0..).zip(axes).map(move |(i, of)| (frame, i, of)));
    let lines = axes.filter(turns).flat_map(|(frame, axis, values)| {
        let mean = values.iter().map(|(x, _)| x).sum::<f64>() / n as f64;
        let power: f64 = values.iter().map(|(x, _)| (x - mean).powi(2)).sum::<f64>() / n as f64;
        let spectrum = fourier.transform(values.iter().map(|(x, _)| x - mean));
        // The number of frequencies is limited: lines of interest lie well below the sampling rate.
        let inner = spectrum.into_iter().enumerate().take((n / 2).min(4000)).skip(3);
        inner.map(move |(k, x)| {
            let amplitude_n_m = 2.0 * x.norm() / n as f64;
            let share = 0.5 * amplitude_n_m * amplitude_n_m / power.max(f64::MIN_POSITIVE);
            SpectralLine { frequency_hz: k as f64 / length_s, amplitude_n_m, frame, axis, share }
        })
    });
    let matters = |line: &SpectralLine| {
        0.5 * line.amplitude_n_m.powi(2) > OF_CONSEQUENCE * largest
            && line.share > LEAST_SHARE
            && is_significant(line.share, n / 2)
    };
    lines.filter(matters).reduce(|best, line| if line.share > best.share { line } else { best })
}

/// Fisher's g against its critical value: P(g > x) < m (1 - x)^(m - 1).
fn is_significant(share: f64, frequencies: usize) -> bool {
    let m = frequencies as f64;
    m * (1.0 - share.min(1.0)).powf(m - 1.0) < FALSE_ALARM
}
