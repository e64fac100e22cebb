//! The result of a comparison in one or two sentences.

use std::fmt;

use whorl_math::three_digits;

use super::verdict::{FEWEST, prediction_error};
use super::{ChannelErrors, Comparison, Unexplained, Whiteness};

/// Largest ratio to the predicted deviation at which a channel counts as explained.
const EXPLAINED: f64 = 1.1;
/// Errors beyond noise up to which a model is right to all purposes: what is left then adds a tenth to the noise's variance.
pub const SMALL_ERROR: f64 = 0.05;
/// Motors' torques below this share of the largest torque go without saying.
const LEAST_TOLD: f64 = 0.01;
/// Probability that the innovations of a true model are called correlated, all channels of a run together.
const FALSE_ALARM: f64 = 0.01;
/// Largest number of correlated channels to name.
const NAMED: usize = 3;

/// A horizon in seconds: 10 and not 10.0, 2.5 of a run of 9.995 s.
pub fn ahead(horizon_s: f64) -> String {
    let text = three_digits(horizon_s);
    text.parse().map_or(text, |rounded: f64| rounded.to_string())
}

impl Comparison {
    /// Run and platform.
    pub fn title(&self) -> String {
        if self.platform.is_empty() { self.run.clone() } else { format!("{}, {}", self.run, self.platform) }
    }

    /// The answer in words.
    pub fn answer(&self) -> String {
        let error = match self.prediction.zip(self.prediction_error()) {
            Some((of, ratio)) => {
                let (ahead, times) = (ahead(of.horizon_s), three_digits(ratio));
                format!("predictions of {ahead} s err {times} times what noise explains")
            }
            None => "it is too short for predictions ahead".to_owned(),
        };
        // Whether something is left is one question, how much of it another: a long run shows the smallest error for certain.
        let size = match self.small_error() {
            _ if self.is_noise() => "the model explains the data to the noise".to_owned(),
            Some(size) => {
                let percent = (100.0 * size).ceil().max(1.0);
                format!("the model explains the data within {percent} %, though what is left is significant")
            }
            None => "the model does not explain the data".to_owned(),
        };
        let chi_squared = three_digits(self.absolute.chi_squared_per_degree);
        let (title, most) = (self.title(), self.absolute.band_99.1);
        let mut text = format!(
            "{title}: {size}: {error} (chi-squared per degree of freedom {chi_squared}, 99 % band up to {most:.3})."
        );
        if self.is_noise() {
            return text;
        }
        if let Some((channel, horizon_s, rms, ratio)) = self.worst().filter(|of| of.3 > EXPLAINED) {
            let (name, (unit, factor)) = (&channel.name, channel.quantity.shown_unit());
            let (ahead, [rms, ratio]) = (ahead(horizon_s), [rms * factor, ratio].map(three_digits));
            text.push_str(&format!(
                " Worst is {name}: {rms} {unit} RMS {ahead} s ahead, {ratio} times its predicted deviation."
            ));
        }
        if self.unexplained.is_some() {
            text.push_str(&format!(" Unexplained: {}.", self.unexplained));
        }
        text
    }

    /// The channel that is predicted worst over its longest horizon that is shorter than the run: with its seconds, RMS, ratio.
    fn worst(&self) -> Option<(&ChannelErrors, f64, f64, f64)> {
        let longest = self
            .channels
            .iter()
            .filter_map(|of| of.horizons.iter().rev().find_map(|h| Some((of, h.horizon_s?, h.rms, h.ratio))));
        longest.filter(|(.., ratio)| ratio.is_finite()).max_by(|a, b| a.3.total_cmp(&b.3))
    }

    /// How much larger errors are than noise makes them, of predictions and of the whole run, where that is little in every channel.
    pub fn small_error(&self) -> Option<f64> {
        let whole = self.absolute.chi_squared_per_degree.sqrt();
        let size = self.prediction_error().unwrap_or(whole).max(whole) - 1.0;
        let worst = self.worst().map_or(0.0, |(.., ratio)| ratio);
        (size <= SMALL_ERROR && worst <= EXPLAINED).then_some(size.max(0.0))
    }

    /// Whether the innovations of the model alone are white, in a sentence.
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
        coloured.sort_by(|a, b| b.ljung_box.statistic.total_cmp(&a.ljung_box.statistic));
        let named = |of: &&Whiteness| {
            format!("of {} over about {} s", of.channel, three_digits(of.correlated_over_s))
        };
        let named = coloured.iter().take(NAMED).map(named).collect::<Vec<_>>().join(", ");
        let others = match coloured.len().saturating_sub(NAMED) {
            0 => String::new(),
            others => format!(", and of {others} other channels"),
        };
        format!(
            "Innovations of the model alone are correlated, so that something is left to predict: those {named}{others}."
        )
    }

    /// That of all channels together; `None` if the run is too short for predictions ahead.
    pub fn prediction_error(&self) -> Option<f64> {
        prediction_error([self])
    }

    /// Whether the run is consistent with the model and noise alone.
    pub fn is_noise(&self) -> bool {
        !self.unexplained.is_some() && self.absolute.chi_squared_per_degree <= self.absolute.band_99.1
    }
}

impl fmt::Display for Unexplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let milli = |x: f64| three_digits(x * 1e3);
        let mut parts = Vec::new();
        if self.torque_b_n_m.iter().any(|x| *x > 0.0) {
            parts.push(format!("{} mN m about x, y, z of the body", self.torque_b_n_m.map(milli).join(", ")));
        }
        let least = LEAST_TOLD * self.all_n_m().fold(0.0, f64::max);
        let motors = self.motors_n_m.iter().filter(|(_, stddev)| *stddev > least);
        parts.extend(motors.map(|(name, stddev)| format!("{} mN m of {name}'s motor", milli(*stddev))));
        write!(f, "{} (standard deviation)", parts.join("; "))
    }
}
