//! The numbers that sway a prediction, each with its source.

use serde::Serialize;

/// Numbers of the predictor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// Largest share of a radian, or of a time constant, that the fastest motion makes in one step of the covariance: the
    /// midpoint rule then errs by less than its cube over twelve, 1e-4 of a covariance's change.
    pub covariance_step: f64,
    /// Derivatives are held while attitude and rate are no further away than this \[rad\], rates against the fastest motion: a
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
    /// Correlation time of a torque that the model does not have \[s\]: the middle one of the horizons over which predictions
    /// are shown. Faster ones look like noise of readings, slower ones like a bias that the filter follows.
    pub disturbance_correlation_s: f64,
    /// Instants by which the start is found where disturbances are allowed: with them a start is soon forgotten.
    pub level_start_instants: usize,
    /// Passes over the first part of a long run, in which levels are found roughly, and how many instants it has.
    pub level_first_passes: usize,
    /// See there.
    pub level_first_instants: usize,
    /// Passes in which levels are found at most.
    pub level_passes: usize,
    /// Levels stand when none changes by more than this share: the errors of a filter with a level that is so far off are
    /// larger by a few hundredths of it.
    pub level_stands: f64,
    /// Disturbances are there if they make the run likelier by more than this: half the 99.9 % quantile of a chi-squared
    /// variable of six degrees, body axes and three wheels.
    pub level_needed_nats: f64,
    /// Least share of a disturbance's variance that readings take away; below it is not seen at all: rounding.
    pub level_seen: f64,
    /// A step of a level that is hardly seen is longer than the moments say by this power at most: the moments scatter, and with
    /// them a longer step.
    pub level_longest_step: f64,
    /// Factor by which a stated noise may be off, one standard deviation. An assumption: data sheets give typical values, and the
    /// bandwidth that is set changes them. It counts only where there are few readings.
    pub stated_noise_factor: f64,
    /// Threads on which recordings are looked at side by side; results do not depend on it.
    pub threads: usize,
    /// Share of a parameter's unit over which differences are taken: the motion is linear over it to about as much.
    pub fit_difference: f64,
    /// The same as `derivatives_held` of a fit: where derivatives are made anew depends on the parameters, and the likelihood jumps there
    /// by as much as gains change; five times closer, jumps are smaller than what counts as evidence.
    pub fit_derivatives_held: f64,
    /// Parameters stand when a step would make the recordings likelier by no more than this (natural logarithm): they are then closer to
    /// the likeliest than a tenth of their deviations.
    pub fit_stands_nats: f64,
    /// The same of the first values, whose levels are those of a worse model, and of what new levels must bring: less is no evidence.
    pub fit_round_nats: f64,
    /// Steps with the same levels at most.
    pub fit_steps: usize,
    /// How often levels are found anew at most.
    pub fit_rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            covariance_step: 0.1,
            derivatives_held: 0.05,
            start_attitude_rad: std::f64::consts::PI / 3f64.sqrt(),
            start_readings: 10.0,
            start_force_rad: 0.3,
            start_stands_nats: 0.01,
            start_kept: 0.01,
            start_passes: 12,
            disturbance_correlation_s: 1.0,
            level_start_instants: 300,
            level_first_passes: 4,
            level_first_instants: 3000,
            level_passes: 8,
            level_stands: 0.25,
            level_needed_nats: 11.2,
            level_seen: 1e-4,
            level_longest_step: 4.0,
            stated_noise_factor: 1.5,
            threads: 2,
            fit_difference: 1e-3,
            fit_derivatives_held: 0.01,
            fit_stands_nats: 0.01,
            fit_round_nats: 0.5,
            fit_steps: 10,
            fit_rounds: 8,
        }
    }
}
