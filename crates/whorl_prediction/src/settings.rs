//! The numbers that sway a prediction, each with its source.

use serde::Serialize;

/// One of the numbers, as `whorl diagnose --settings` prints it.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Its name.
    pub name: &'static str,
    /// Its value, as it is written.
    pub value: String,
    /// Meaning, unit and source.
    pub doc: String,
}

/// Readings of this time are taken in together where models are fitted and compared, if nothing is faster ([`crate::longest_cell_s`]) \[s\]. Of 90 numbers
/// of drawn rigs the estimates were within 0.3 deviations of those by each reading, and as well known to 2 % (`tests/fits.rs`).
pub const CELL_S: f64 = 0.05;

macro_rules! settings {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty = $default:expr;)+) => {
        /// Numbers of the predictor.
        #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
        pub struct Settings {
            $($(#[doc = $doc])+ pub $name: $kind,)+
        }

        impl Default for Settings {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }

        impl Settings {
            /// All of them, in groups that belong together.
            pub fn listed(&self) -> Vec<Setting> {
                vec![$(Setting {
                    name: stringify!($name),
                    value: format!("{:?}", self.$name),
                    doc: [$($doc),+].map(str::trim).join(" ").replace("\\[", "[").replace("\\]", "]"),
                },)+]
            }
        }
    };
}

settings! {
    /// Largest share of a radian, or of a time constant, that the fastest motion makes in one step of the covariance: the
    /// midpoint rule then errs by less than its cube over twelve, 1e-4 of a covariance's change.
    covariance_step: f64 = 0.1;
    /// Derivatives are held while attitude and rate are no further away than this \[rad\], rates against the fastest motion. Of 46,000 readings of a
    /// platform that swings slowly log p then errs by up to half a nat, and by up to ten at 0.01; every step anew takes twice as long.
    derivatives_held: f64 = 0.003;
    /// Readings of so long a time are taken in together, as their means \[s\]; none: each by itself. The motion is predicted at each reading all the same.
    cell_s: f64 = 0.0;
    /// How far the attitude may be from the guess at the start, standard deviation about each axis \[rad\]: of an angle of which nothing is known.
    start_attitude_rad: f64 = std::f64::consts::PI / 3f64.sqrt();
    /// How far a rate, a speed or a direction may be from its first reading, in standard deviations of that reading: so wide
    /// that the reading counts for next to nothing, and narrow enough for small angles where sensors are good.
    start_readings: f64 = 10.0;
    /// How far the vertical may be from the first specific force, which the motion tilts \[rad\]: 3 m/s^2 of 10.
    start_force_rad: f64 = 0.3;
    /// A start stands when log p changes by no more than this from one pass to the next (natural logarithm): a hundredth of evidence worth a mention.
    start_stands_nats: f64 = 0.01;
    /// Share of what a run says of its start that the filter begins with, beside what was known before: it makes angles small,
    /// and counts the run's readings by this much more than once.
    start_kept: f64 = 0.01;
    /// How often a start is found anew at most.
    start_passes: usize = 12;
    /// Correlation times of the torque on the body that the model does not have \[s\], a sum of three random ones about each axis, those that are shorter
    /// than the run: within 1.2 nats of the true time from 0.3 to 10 s. A single one of 1 s was short by 23 where it was 3 s, by 70 where it was 10 s.
    disturbance_correlations_s: [f64; 4] = [0.03, 0.3, 3.0, 30.0];
    /// The same of each motor's torque \[s\]: the middle one of the horizons over which predictions are shown. Faster ones look like noise
    /// of the tachometer, slower ones like friction.
    motors_correlation_s: f64 = 1.0;
    /// Instants by which the start is found where disturbances are allowed: with them a start is soon forgotten.
    level_start_instants: usize = 300;
    /// Instants of the first part of a run, in which levels are found roughly; further parts are six times as long as those before.
    level_first_instants: usize = 1000;
    /// Steps of levels at most.
    level_steps: usize = 8;
    /// Levels stand when a step would make the run likelier by no more than this (natural logarithm): they are within their deviations then.
    level_stands_nats: f64 = 0.3;
    /// What the level of a random torque costs log evidence, and one whose best level makes the run likelier by less is left out (natural logarithm):
    /// that of the seven sizes that levels begin with, decades apart, of which none is likelier before.
    level_seen_nats: f64 = 1.95;
    /// Disturbances are there if they make a run likelier than chance does in 999 of 1000: by half the quantile of a chi-squared variable with
    /// as many degrees as there are torques that show, which is this many deviations of a normal variable.
    level_needed_deviations: f64 = 3.09;
    /// Factor by which a stated noise may be off, one standard deviation, which counts where there are few readings. An assumption: data sheets give
    /// typical values, and the bandwidth that is set changes them.
    stated_noise_factor: f64 = 1.5;
    /// Relative error of the impulse of a touch, one standard deviation. An assumption: impacts of the same bodies scatter by some per cent,
    /// and a model's stop is a stand-in. Of a platform that swings from stop to stop log p then jumped by up to 3 nats between delays of valves half a
    /// millisecond apart, by up to 13 at 0.03, by up to 25 at none.
    touch_impulse_share: f64 = 0.1;
    /// How long a touch takes that has this error \[s\]: half a swing of a bearing's own stop, pi over the root of its stiffness by
    /// inertia (233 1/s^2); what leans for longer has errors that are independent from one such time to the next.
    touch_s: f64 = 0.2;
    /// Threads on which recordings are looked at side by side; results do not depend on it.
    threads: usize = 2;
    /// Share of a parameter's unit over which differences are taken: the motion is linear over it to about as much.
    fit_difference: f64 = 1e-3;
    /// Parameters stand when a step would make the recordings likelier by no more than this (natural logarithm): they are then closer to
    /// the likeliest than a tenth of their deviations.
    fit_stands_nats: f64 = 0.01;
    /// The same of the first values, whose levels are those of a worse model, and of what new levels must bring: less is no evidence.
    fit_round_nats: f64 = 0.5;
    /// Steps with the same levels at most.
    fit_steps: usize = 10;
    /// How often levels are found anew at most.
    fit_rounds: usize = 8;
}
