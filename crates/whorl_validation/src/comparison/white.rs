//! Are the innovations of the model alone white? With the true model each is independent of all before it.

use serde::Serialize;
use whorl_math::three_digits;

use crate::statistics::{LjungBox, NORMAL_99, ljung_box};

/// Lags of the test.
pub(super) const LAGS: usize = 25;
/// Longest lag that is looked at to say over which time innovations are correlated.
const LONGEST: usize = 1000;
/// Probability that the innovations of a true model are called correlated, all channels of a run together.
const FALSE_ALARM: f64 = 0.01;
/// Channels that are named.
const NAMED: usize = 3;

/// Whiteness of one channel's innovations with the model alone.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct White {
    /// Channel.
    pub channel: String,
    /// The portmanteau test of Ljung and Box of their first autocorrelations.
    pub ljung_box: LjungBox,
    /// Time over which they are correlated: to the first lag whose autocorrelation is within its 99 % band \[s\]; zero for white ones.
    pub correlated_over_s: f64,
}

impl White {
    /// Of innovations over their deviations, `step_s` apart; `None` where there are too few.
    pub(super) fn of(channel: String, values: &[f64], step_s: f64) -> Option<Self> {
        let ljung_box = ljung_box(values, u32::try_from(LAGS).unwrap_or(u32::MAX))?;
        let lags = if ljung_box.is_white() { 0 } else { correlated_lags(values) };
        Some(Self { channel, ljung_box, correlated_over_s: lags as f64 * step_s })
    }
}

/// How many of the first lags have an autocorrelation beyond its 99 % band, one after the other; at least one.
fn correlated_lags(values: &[f64]) -> usize {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let power: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    let band = NORMAL_99 / (values.len() as f64).sqrt() * power;
    let is_correlated = |lag: &usize| {
        let later = values.get(*lag..).unwrap_or(&[]);
        values.iter().zip(later).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>().abs() > band
    };
    let longest = LONGEST.min(values.len() / 4);
    (1..=longest).take_while(is_correlated).count().max(1)
}

/// "Innovations of the model alone are white ..."
pub(super) fn in_words(channels: &[White]) -> String {
    if channels.is_empty() {
        return format!(
            "The run is too short to see whether innovations are white: fewer than {} readings.",
            4 * LAGS
        );
    }
    // All channels together: the level of each is as much smaller (Bonferroni).
    let level = FALSE_ALARM / channels.len() as f64;
    let mut coloured: Vec<&White> = channels.iter().filter(|of| of.ljung_box.p_value < level).collect();
    if coloured.is_empty() {
        return "Innovations of the model alone are white: each reading differs from its prediction by noise that nothing before foretells."
            .to_owned();
    }
    coloured.sort_by(|a, b| {
        (b.ljung_box.statistic / b.ljung_box.limit_99)
            .total_cmp(&(a.ljung_box.statistic / a.ljung_box.limit_99))
    });
    let named: Vec<String> = coloured
        .iter()
        .take(NAMED)
        .map(|of| format!("of {} over about {} s", of.channel, three_digits(of.correlated_over_s)))
        .collect();
    let others = coloured.len().saturating_sub(NAMED);
    let others = if others > 0 { format!(", and of {others} other channels") } else { String::new() };
    format!(
        "Innovations of the model alone are correlated, so that something is left to predict: those {}{others}.",
        named.join(", ")
    )
}
