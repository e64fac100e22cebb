//! The result of a comparison in one or two sentences.

use super::{ChannelErrors, Comparison};

/// Largest ratio to the noise floor at which a channel counts as explained.
const EXPLAINED: f64 = 1.1;
/// Largest number of findings to report.
const FINDINGS: usize = 3;

impl Comparison {
    /// The answer in words.
    #[must_use]
    pub fn answer(&self) -> String {
        let mut text = match &self.absolute {
            Some(absolute) if absolute.is_noise() => format!(
                "{}: the model explains the data to the noise (chi-squared per degree of freedom {:.3}, 99 % band up to {:.3}).",
                self.run, absolute.chi_squared_per_degree, absolute.band_99.1
            ),
            Some(absolute) => format!(
                "{}: the model does not explain the data: the prediction error is {:.2} times the noise (chi-squared per degree of freedom {:.2}, 99 % band up to {:.3}).",
                self.run,
                absolute.prediction_error(),
                absolute.chi_squared_per_degree,
                absolute.band_99.1
            ),
            None => format!("{}: too little data for a test against noise alone.", self.run),
        };
        let worst = self.channels.iter().filter_map(|c| worst_horizon(c).map(|h| (c, h)));
        if let Some((channel, (horizon_s, rms, ratio))) =
            worst.max_by(|a, b| a.1.2.total_cmp(&b.1.2)).filter(|(_, (_, _, ratio))| *ratio > EXPLAINED)
        {
            let (unit, factor) = channel.quantity.shown_unit();
            text.push_str(&format!(
                " Worst is {}: {:.3} {unit} RMS over {} s, {ratio:.1} times its noise floor of {:.3} {unit}.",
                channel.name,
                rms * factor,
                horizon_s,
                channel.noise_floor * factor
            ));
        }
        text
    }

    /// Findings of the whiteness tests, one sentence each, the most significant first.
    #[must_use]
    pub fn findings(&self) -> Vec<String> {
        // With the significance of each: power of a line, or correlation over its band.
        let mut findings: Vec<(f64, String)> = Vec::new();
        for w in &self.whiteness {
            if let Some(line) = w.periodogram.as_ref().filter(|p| !p.is_white()).and_then(|p| p.line_hz) {
                let text =
                    format!("{}: a line at {line:.2} Hz stands out of the residual's spectrum.", w.channel);
                findings.push((f64::INFINITY, text));
            }
            if let Some(input) = w.inputs.first().filter(|i| i.significant) {
                let text = format!(
                    "{}: the residual correlates with {} (correlation {:.3} after {} samples, 99 % band {:.3}).",
                    w.channel, input.input, input.value, input.lag, input.correlation.joint_band_99
                );
                findings.push((input.value.abs() / input.correlation.joint_band_99, text));
            }
        }
        findings.sort_by(|a, b| b.0.total_cmp(&a.0));
        findings.into_iter().take(FINDINGS).map(|(_, text)| text).collect()
    }

    /// The prediction error over all channels, relative to the noise; `None` if it could not be tested.
    #[must_use]
    pub fn prediction_error(&self) -> Option<f64> {
        self.absolute.as_ref().map(super::Absolute::prediction_error)
    }

    /// Whether the residuals are consistent with noise; `None` if this could not be tested.
    #[must_use]
    pub fn is_noise(&self) -> Option<bool> {
        self.absolute.as_ref().map(super::Absolute::is_noise)
    }
}

/// The longest finite horizon of a channel: its seconds, RMS, ratio.
fn worst_horizon(channel: &ChannelErrors) -> Option<(f64, f64, f64)> {
    let longest = channel.horizons.iter().rev().find_map(|h| h.horizon_s.map(|s| (s, h.rms, h.ratio)));
    longest.filter(|(_, _, ratio)| ratio.is_finite())
}
