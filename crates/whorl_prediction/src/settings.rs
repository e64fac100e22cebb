//! The numbers that sway a prediction, each with its source.

use serde::Serialize;

/// Numbers of the predictor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// Largest share of a radian, or of a time constant, that the fastest motion makes in one step of the covariance: the
    /// midpoint rule then errs by less than its cube over twelve, 1e-4 of a covariance's change.
    pub covariance_step: f64,
    /// Derivatives are held while the fastest motion makes no more than this share of a radian, or of a time constant: a
    /// gain then errs by about as much.
    pub derivatives_held: f64,
    /// How far the attitude may be from the guess at the start, standard deviation about each axis \[rad\]: that of an
    /// angle of which nothing is known, pi over the root of three.
    pub start_attitude_rad: f64,
    /// How far a rate, a speed or a direction may be from its first reading, in standard deviations of that reading: so wide
    /// that the reading counts for next to nothing, and narrow enough for small angles where sensors are good.
    pub start_readings: f64,
    /// How far the vertical may be from the first specific force, which the motion tilts \[rad\]: 3 m/s^2 of 10.
    pub start_force_rad: f64,
    /// A start stands when the log likelihood changes by no more than this from one pass to the next (natural logarithm): a hundredth of
    /// what counts as evidence worth a mention.
    pub start_stands_nats: f64,
    /// Share of what a run says of its start that the filter begins with, beside what was known before: it makes angles small,
    /// and counts the run's readings by this much more than once.
    pub start_kept: f64,
    /// How often a start is found anew at most.
    pub start_passes: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            covariance_step: 0.1,
            derivatives_held: 0.03,
            start_attitude_rad: std::f64::consts::PI / 3f64.sqrt(),
            start_readings: 10.0,
            start_force_rad: 0.3,
            start_stands_nats: 0.01,
            start_kept: 0.01,
            start_passes: 12,
        }
    }
}
