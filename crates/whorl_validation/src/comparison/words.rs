//! The result of a comparison in one or two sentences.

use std::fmt;

use whorl_math::three_digits;

use super::whiteness::FEWEST;
use super::{ChannelErrors, Comparison, Unexplained, Whiteness, ahead};

/// Largest ratio to the predicted deviation at which a channel counts as explained.
const EXPLAINED: f64 = 1.1;
/// Errors of predictions and of the whole run beyond noise up to which a model is right to all purposes: what is left then adds a
/// tenth to the noise's variance.
pub const SMALL_ERROR: f64 = 0.05;
/// Motors' torques below this share of the largest torque go without saying.
const LEAST_TOLD: f64 = 0.01;
/// Probability that the innovations of a true model are called correlated, all channels of a run together.
const FALSE_ALARM: f64 = 0.01;
/// Largest number of correlated channels to name.
const NAMED: usize = 3;

impl Comparison {
    /// Run and platform.
    #[must_use]
    pub fn title(&self) -> String {
        if self.platform.is_empty() { self.run.clone() } else { format!("{}, {}", self.run, self.platform) }
    }

    /// The answer in words.
    #[must_use]
    pub fn answer(&self) -> String {
        let of_test = format!(
            "chi-squared per degree of freedom {}, 99 % band up to {:.3}",
            three_digits(self.absolute.chi_squared_per_degree),
            self.absolute.band_99.1
        );
        let error = self.prediction.map(|of| {
            format!(
                "predictions of {} s err {} times what noise explains",
                ahead(of.horizon_s),
                three_digits(of.ratio())
            )
        });
        let error = error.unwrap_or_else(|| "it is too short for predictions ahead".to_owned());
        let run = self.title();
        if self.is_noise() {
            return format!("{run}: the model explains the data to the noise: {error} ({of_test}).");
        }
        // Whether something is left is one question, how much of it another: a long run shows the smallest error for certain.
        let size = match self.small_error() {
            Some(size) => {
                let percent = (100.0 * size).ceil().max(1.0);
                format!("the model explains the data within {percent} %, though what is left is significant")
            }
            None => "the model does not explain the data".to_owned(),
        };
        let mut text = format!("{run}: {size}: {error} ({of_test}).");
        let worst = self.channels.iter().filter_map(|c| worst_horizon(c).map(|h| (c, h)));
        if let Some((channel, (horizon_s, rms, ratio))) =
            worst.max_by(|a, b| a.1.2.total_cmp(&b.1.2)).filter(|(_, (_, _, ratio))| *ratio > EXPLAINED)
        {
            let (unit, factor) = channel.quantity.shown_unit();
            text.push_str(&format!(
                " Worst is {}: {} {unit} RMS {} s ahead, {} times its predicted deviation.",
                channel.name,
                three_digits(rms * factor),
                ahead(horizon_s),
                three_digits(ratio)
            ));
        }
        if self.unexplained.is_some() {
            text.push_str(&format!(" Unexplained: {}.", self.unexplained));
        }
        text
    }

    /// How much larger errors are than noise makes them, where that is little: of predictions, of the whole run, and in no channel
    /// more than chance may explain.
    #[must_use]
    pub fn small_error(&self) -> Option<f64> {
        let whole = self.absolute.chi_squared_per_degree.sqrt();
        let size = self.prediction_error().unwrap_or(whole).max(whole) - 1.0;
        let worst = self.channels.iter().filter_map(worst_horizon).map(|(.., ratio)| ratio);
        (size <= SMALL_ERROR && worst.fold(0.0, f64::max) <= EXPLAINED).then_some(size.max(0.0))
    }

    /// Whether the innovations of the model alone are white, in a sentence.
    #[must_use]
    pub fn said_of_innovations(&self) -> String {
        if self.whiteness.is_empty() {
            return format!(
                "The run is too short to see whether innovations are white: fewer than {FEWEST} readings."
            );
        }
        // All channels together: the level of each is as much smaller (Bonferroni).
        let level = FALSE_ALARM / self.whiteness.len() as f64;
        let mut coloured: Vec<&Whiteness> =
            self.whiteness.iter().filter(|of| of.ljung_box.p_value < level).collect();
        if coloured.is_empty() {
            return "Innovations of the model alone are white: each reading differs from its prediction by noise that nothing before foretells."
                .to_owned();
        }
        let excess = |of: &Whiteness| of.ljung_box.statistic / of.ljung_box.limit_99;
        coloured.sort_by(|a, b| excess(b).total_cmp(&excess(a)));
        let named = |of: &&Whiteness| {
            format!("of {} over about {} s", of.channel, three_digits(of.correlated_over_s))
        };
        let named: Vec<String> = coloured.iter().take(NAMED).map(named).collect();
        let others = coloured.len().saturating_sub(NAMED);
        let others = if others > 0 { format!(", and of {others} other channels") } else { String::new() };
        format!(
            "Innovations of the model alone are correlated, so that something is left to predict: those {}{others}.",
            named.join(", ")
        )
    }

    /// The prediction error over all channels, relative to what the model predicts; `None` if the run is too short for
    /// predictions ahead.
    #[must_use]
    pub fn prediction_error(&self) -> Option<f64> {
        self.prediction.map(|of| of.ratio())
    }

    /// Whether the run is consistent with the model and noise alone.
    #[must_use]
    pub fn is_noise(&self) -> bool {
        !self.unexplained.is_some() && self.absolute.chi_squared_per_degree <= self.absolute.band_99.1
    }
}

impl fmt::Display for Unexplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let milli = |x: &f64| three_digits(x * 1e3);
        let torque: Vec<String> = self.torque_b_n_m.iter().map(milli).collect();
        let mut parts = Vec::new();
        if self.torque_b_n_m.iter().any(|x| *x > 0.0) {
            parts.push(format!("{} mN m about x, y, z of the body", torque.join(", ")));
        }
        let all = self.torque_b_n_m.iter().chain(self.motors_n_m.iter().map(|(_, x)| x));
        let least = LEAST_TOLD * all.fold(0f64, |most, x| most.max(*x));
        let motors = self.motors_n_m.iter().filter(|(_, stddev)| *stddev > least);
        parts.extend(motors.map(|(name, stddev)| format!("{} mN m of {name}'s motor", milli(stddev))));
        write!(f, "{} (standard deviation)", parts.join("; "))
    }
}

/// The longest horizon of a channel that is shorter than the run: its seconds, RMS, ratio.
fn worst_horizon(channel: &ChannelErrors) -> Option<(f64, f64, f64)> {
    let longest = channel.horizons.iter().rev().find_map(|h| h.horizon_s.map(|s| (s, h.rms, h.ratio)));
    longest.filter(|(_, _, ratio)| ratio.is_finite())
}
