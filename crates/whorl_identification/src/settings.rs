//! Every number that a verdict depends on and that somebody chose. METHOD.md has a table of them, and says which numbers are no settings.

use whorl_prediction::{CELL_S, Setting};

/// In words what values a setting may have, and a number below which they are, above 0.
const POSITIVE: (&str, f64) = ("a number > 0", f64::INFINITY);
const SHARE: (&str, f64) = ("a number between 0 and 1", 1.0);

/// What the table says of a setting.
fn doc_of(name: &str) -> &'static str {
    let row =
        include_str!("../METHOD.md").lines().find_map(|row| row.strip_prefix(&format!("| `{name}` | ")));
    row.and_then(|row| row.split_once(" | ")).map_or("", |(_, doc)| doc.trim_end_matches(" |"))
}

macro_rules! settings {
    ($($(#[doc = $doc:literal])+ $name:ident = $default:expr, $allowed:expr;)+) => {
        /// Every number that a verdict depends on and that somebody chose. `whorl diagnose --settings` prints them.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Settings {
            $($(#[doc = $doc])+ pub $name: f64,)+
            /// Numbers of the predictor, by which everything is evaluated.
            pub prediction: whorl_prediction::Settings,
        }

        impl Default for Settings {
            fn default() -> Self {
                let prediction =
                    whorl_prediction::Settings { cell_s: CELL_S, ..whorl_prediction::Settings::default() };
                Self { $($name: $default,)+ prediction }
            }
        }

        impl Settings {
            /// All of them, in groups that belong together.
            pub fn listed(&self) -> Vec<Setting> {
                vec![$(Setting {
                    name: stringify!($name),
                    value: format!("{:?}", self.$name),
                    doc: format!("{} Allowed: {}.", doc_of(stringify!($name)), $allowed.0),
                },)+]
            }

            /// Gives the setting of this name another value.
            ///
            /// # Errors
            /// What is allowed: which names there are, or which values.
            pub fn set(&mut self, name: &str, value: f64) -> Result<(), String> {
                let (slot, (words, below)) = match name {
                    $(stringify!($name) => (&mut self.$name, $allowed),)+
                    _ => {
                        let names = [$(stringify!($name)),+].join(", ");
                        return Err(format!("there is no setting {name}; allowed: {names}"));
                    }
                };
                if !(value > 0.0 && value < below) {
                    return Err(format!("{name}: allowed: {words}"));
                }
                *slot = value;
                Ok(())
            }
        }
    };
}

settings! {
    /// Probability that a given effect of the catalogue is missing, before any data \[1\].
    present = 0.005, SHARE;
    /// Probability that something is missing that the catalogue does not have, before any data \[1\].
    unmodelled = 0.01, SHARE;
    /// Share of the evidence of an effect that its own wrong shape may leave to a second effect: a tenth of its size; its square of exact formulas \[1\].
    misspecification = 0.01, SHARE;
    /// Standard deviation of a slow random torque, over the RMS of the applied torques, from which it is no background \[1\].
    background_share = 0.01, SHARE;
    /// Time over which rates are compared to see what torque was applied \[s\].
    at_work_s = 0.5, POSITIVE;
    /// Size of an effect, over the catalogue's, from which it is unusual \[1\].
    unusual_size = 100.0, POSITIVE;
    /// One rig in so many has an effect of unusual size \[1\].
    unusual_odds = 100.0, POSITIVE;
    /// Widening of the stated prior deviations of the platform's own parameters \[1\].
    prior_margin = 1.2, POSITIVE;
    /// Probability that makes an answer \[1\].
    sure = 0.95, SHARE;
    /// Probability, over that of the most probable set, below which it is not mentioned \[1\].
    worth_mentioning = 1e-3, SHARE;
    /// Log evidence by which a set may be behind the best one and still be fitted, and which lines that only samples show must have \[nats\].
    window_nats = 10.0, POSITIVE;
    /// Log evidence that is worth a second look: a stated low-pass that is doubted, a set that wins by its noise levels \[nats\].
    doubt_nats = 3.0, POSITIVE;
    /// Predicted gain of log likelihood below which a fit takes no further step \[nats\].
    converged_nats = 0.3, POSITIVE;
    /// The same of fits that compare what a stated low-pass may be \[nats\].
    unfinished_nats = 1.0, POSITIVE;
    /// Drop of the whitened misfit that cannot be overlooked, in variances of the noise \[1\].
    clear_misfit = 30.0, POSITIVE;
    /// Error of predictions, over that of noise, up to which nothing without a name is said to be missing \[1\].
    at_the_noise = 1.1, POSITIVE;
    /// The same from which on something is missing, whatever the sets that were compared say of each other \[1\].
    above_the_noise = 1.5, POSITIVE;
    /// Gain of log likelihood, over half the squared distance of the effects from none in deviations, from which something else than these effects made it \[1\].
    most_over_effects = 4.0, POSITIVE;
    /// Share of the gyro's readings that must be within its range for these to name anything \[1\].
    least_within_range = 0.5, SHARE;
    /// Standard deviations from which the residual is worth a search, and by which the noise of a run is odd \[1\].
    noticed_stddevs = 3.0, POSITIVE;
    /// Standard deviations from which a line is no chance \[1\].
    certain_stddevs = 5.5, POSITIVE;
    /// Factor between stated and true noise that is usual \[1\].
    noise_factor = 1.3, POSITIVE;
    /// Power of the innovations that do not know the torques, over that of the noise, from which gyro and attitude sensors contradict each other \[1\].
    contradiction_power = 2.5, POSITIVE;
    /// Posterior over prior deviation above which a parameter of the platform stays as given beside a set \[1\].
    unshown = 0.975, SHARE;
    /// Prior deviations by which a moment of inertia may be off on the same platform \[1\].
    other_platform_stddevs = 5.0, POSITIVE;
    /// Least prior deviation of a moment of inertia for that test, over the moment \[1\].
    least_inertia_share = 0.05, SHARE;
    /// Lowest frequency of a vibration that is looked for in the samples \[Hz\].
    slowest_vibration_hz = 4.0, POSITIVE;
    /// Time for which wheel angles integrated from speeds stay good \[s\].
    wheel_angle_s = 30.0, POSITIVE;
    /// Cycles per turn of a wheel, off one, that are still its imbalance \[1\].
    imbalance_turn_share = 0.02, SHARE;
}

#[cfg(test)]
mod tests;
