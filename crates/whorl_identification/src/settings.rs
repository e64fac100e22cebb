//! Every number that a verdict depends on and that somebody chose. METHOD.md says which numbers are no settings.

use std::fmt;

use whorl_prediction::CELL_S;

/// What values a setting may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Allowed {
    /// A number > 0.
    Positive,
    /// A number between 0 and 1, both excluded.
    Share,
}

impl Allowed {
    fn holds(self, value: f64) -> bool {
        value.is_finite() && value > 0.0 && (self == Self::Positive || value < 1.0)
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Positive { "a number > 0" } else { "a number between 0 and 1" })
    }
}

/// A setting, with its value in some [`Settings`].
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Name of the field.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// What it may be.
    pub allowed: Allowed,
    /// Meaning, unit and source.
    pub doc: String,
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
            #[must_use]
            pub fn listed(&self) -> Vec<Setting> {
                vec![$(Setting {
                    name: stringify!($name),
                    value: self.$name,
                    allowed: $allowed,
                    doc: [$($doc),+].map(str::trim).join(" ").replace("\\[", "[").replace("\\]", "]"),
                },)+]
            }

            /// Gives the setting of this name another value.
            ///
            /// # Errors
            /// What is allowed: which names there are, or which values.
            pub fn set(&mut self, name: &str, value: f64) -> Result<(), String> {
                match name {
                    $(stringify!($name) if $allowed.holds(value) => {
                        self.$name = value;
                        Ok(())
                    }
                    stringify!($name) => Err(format!("{name}: allowed: {}", $allowed)),)+
                    _ => {
                        let names = [$(stringify!($name)),+].join(", ");
                        Err(format!("there is no setting {name}; allowed: {names}"))
                    }
                }
            }
        }
    };
}

settings! {
    /// Probability that a given effect of the catalogue is missing, before any data \[1\].
    /// Assumption: one model in five lacks one of some forty effects.
    present = 0.005, Allowed::Share;
    /// Probability that something is missing that the catalogue does not have, before any data \[1\]; a slow random torque beyond
    /// `background_share` counts as that. Assumption: as likely as two effects of the catalogue.
    unmodelled = 0.01, Allowed::Share;
    /// Share of the evidence of an effect that its own wrong shape may leave to a second effect \[1\]; an unmodelled law or a random
    /// torque must have four times that share (twice the error). Derived from an error of shape of 10 %, squared; the 10 % are an
    /// assumption: no friction, plenum or fan follows its law to better.
    misspecification = 0.01, Allowed::Share;
    /// Standard deviation of a slow random torque, over the RMS of the applied torques, from which it is no background
    /// \[1\]. Measured on simulated rigs without a missing effect.
    background_share = 0.01, Allowed::Share;
    /// Time over which rates are compared to see what torque was applied \[s\]. Assumption: longer than the gyro's noise needs, shorter
    /// than a manoeuvre.
    at_work_s = 0.5, Allowed::Positive;
    /// Size of an effect, over the catalogue's, from which it is unusual \[1\]. Derived from ball bearings, which have a thousand times the friction of air
    /// bearings; beyond it single precision leaves more than the noise.
    unusual_size = 100.0, Allowed::Positive;
    /// One rig in so many has an effect of unusual size \[1\]. Assumption.
    unusual_odds = 100.0, Allowed::Positive;
    /// Widening of the stated prior deviations of the platform's own parameters \[1\]. Assumption: who states one has rarely measured it.
    prior_margin = 1.2, Allowed::Positive;
    /// Probability that makes an answer \[1\]. Convention.
    sure = 0.95, Allowed::Share;
    /// Probability, over that of the most probable set, below which it is not mentioned \[1\].
    /// Assumption: a fiftieth of what `sure` leaves open.
    worth_mentioning = 1e-3, Allowed::Share;
    /// Log evidence by which a set may be behind the best one and still be fitted, and which lines that only samples show must have
    /// \[nats\]. Derived from odds of 20,000 to 1.
    window_nats = 10.0, Allowed::Positive;
    /// Log evidence that is worth a second look: a stated low-pass that is doubted, a set that wins by its noise levels \[nats\]. Derived from odds of 20 to 1.
    doubt_nats = 3.0, Allowed::Positive;
    /// Predicted gain of log likelihood below which a fit takes no further step \[nats\]. Derived: a tenth of `doubt_nats`.
    converged_nats = 0.3, Allowed::Positive;
    /// The same of fits that compare what a stated low-pass may be \[nats\]. Derived: a third of `doubt_nats`.
    unfinished_nats = 1.0, Allowed::Positive;
    /// Drop of the whitened misfit that cannot be overlooked, in variances of the noise: an effect of usual size would have shown, a line in
    /// the samples is there, a step went too far \[1\]. Derived from five and a half standard deviations.
    clear_misfit = 30.0, Allowed::Positive;
    /// Error of predictions, over that of noise, up to which nothing without a name is said to be missing \[1\]. Assumption: no friction, plenum or fan
    /// follows its law to better than a tenth (`misspecification`).
    at_the_noise = 1.1, Allowed::Positive;
    /// The same from which on something is missing, whatever the sets that were compared say of each other \[1\]. Assumption: half as much again as noise;
    /// less is what a random torque adds that is taken into account and is no part of a prediction.
    above_the_noise = 1.5, Allowed::Positive;
    /// Gain of log likelihood, over half the squared distance of the effects from none in deviations, from which something else than these effects
    /// made it \[1\]. Derived: deviations that are wrong by a factor of two.
    most_over_effects = 4.0, Allowed::Positive;
    /// Share of the gyro's readings that must be within its range for these to name anything \[1\]. Assumption: half of them; those that are left
    /// were chosen by their values.
    least_within_range = 0.5, Allowed::Share;
    /// Standard deviations from which the residual is worth a search, and by which the noise of a run is odd \[1\]. Derived: chance in
    /// one of two hundred run sets, over four windows.
    noticed_stddevs = 3.0, Allowed::Positive;
    /// Standard deviations from which a line or a friction of gimbals is no chance \[1\]. Derived from 10^4 frequencies: one false line in 5000
    /// run sets.
    certain_stddevs = 5.5, Allowed::Positive;
    /// Factor between stated and true noise that is usual \[1\]. Assumption: spread of data sheets.
    noise_factor = 1.3, Allowed::Positive;
    /// Power of the innovations that do not know the torques, over that of the noise, from which gyro and attitude sensors contradict each
    /// other \[1\]. Assumption: noise that is stated wrongly by `noise_factor` gives 1.7.
    contradiction_power = 2.5, Allowed::Positive;
    /// Posterior over prior deviation above which a parameter of the platform stays as given beside a set \[1\]. Derived: less than a
    /// twentieth of its information is the recordings'.
    unshown = 0.975, Allowed::Share;
    /// Prior deviations by which a moment of inertia may be off on the same platform \[1\]. Convention of five deviations.
    other_platform_stddevs = 5.0, Allowed::Positive;
    /// Least prior deviation of a moment of inertia for that test, over the moment \[1\]. Assumption: what CAD is good for.
    least_inertia_share = 0.05, Allowed::Share;
    /// Lowest frequency of a vibration that is looked for in the samples \[Hz\]; a mean over 0.6 of its period to both sides is taken off.
    /// Assumption: platforms swing and ring below, sensors shake above.
    slowest_vibration_hz = 4.0, Allowed::Positive;
    /// Time for which wheel angles integrated from speeds stay good \[s\]. Assumption.
    wheel_angle_s = 30.0, Allowed::Positive;
    /// Cycles per turn of a wheel, off one, that are still its imbalance \[1\]. Assumption: error of a tachometer's scale.
    imbalance_turn_share = 0.02, Allowed::Share;
    /// Shortest window in which pulses that nobody recorded are looked for \[s\]. Assumption: pulses of attitude jets are shorter.
    pulse_window_s = 0.25, Allowed::Positive;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_few_and_each_says_what_it_is_and_where_it_is_from() {
        let listed = Settings::default().listed();
        assert!(listed.len() <= 40, "{}", listed.len());
        for setting in &listed {
            assert!(setting.doc.contains('['), "{}: no unit", setting.name);
            let sources = ["Derived", "Measured", "Assumption", "assumption", "Convention"];
            assert!(sources.iter().any(|word| setting.doc.contains(word)), "{}: no source", setting.name);
        }
    }

    #[test]
    fn the_table_of_the_method_is_that_of_the_settings() {
        let row =
            |setting: &Setting| format!("| `{}` | {:?} | {} |", setting.name, setting.value, setting.doc);
        let rows: Vec<String> = Settings::default().listed().iter().map(row).collect();
        let method = include_str!("../METHOD.md");
        let section = method.split("\n## ").find(|part| part.starts_with("Settings\n")).unwrap();
        let written: Vec<&str> = section.lines().filter(|line| line.starts_with("| `")).collect();
        assert_eq!(written, rows, "write these rows into METHOD.md:\n{}", rows.join("\n"));
    }

    #[test]
    fn a_setting_is_changed_by_its_name_and_what_it_cannot_be_is_refused() {
        let mut settings = Settings::default();
        settings.set("sure", 0.9).unwrap();
        let changed = Settings { sure: 0.9, ..Settings::default() };
        assert_eq!(settings, changed);
        for (name, value, part) in [
            ("sure", 1.5, "between 0 and 1"),
            ("at_work_s", 0.0, "> 0"),
            ("at_work_s", f64::NAN, "> 0"),
            ("shure", 0.9, "allowed: present, unmodelled"),
        ] {
            let refused = settings.set(name, value).unwrap_err();
            assert!(refused.contains(part), "{name} {value}: {refused}");
        }
        assert_eq!(settings, changed);
    }
}
