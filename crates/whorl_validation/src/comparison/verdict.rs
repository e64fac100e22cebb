//! The model against the whole run.

use serde::Serialize;
use whorl_math::statistics::chi_squared_quantile;
use whorl_prediction::{Followed, Likelihood, Prepared};

/// Errors of all channels together, over the deviations that the model predicts for them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PredictionError {
    /// Length of each prediction \[s\].
    pub horizon_s: f64,
    /// Sum of the squares of all errors on the way, each over its predicted deviation.
    pub squares: f64,
    /// How many numbers were predicted.
    pub numbers: usize,
}

impl PredictionError {
    /// Root of their mean; 1 = as good as the model says, that is noise alone.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        (self.squares / self.numbers as f64).sqrt()
    }
}

/// Outcome of the test against noise alone: the run from beginning to end with the model alone, each reading against its
/// prediction from everything before it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Absolute {
    /// Sum of squares of the innovations, each over its predicted deviation, over their degrees of freedom; 1 = noise.
    pub chi_squared_per_degree: f64,
    /// 99 % band of this ratio for noise alone.
    pub band_99: (f64, f64),
    /// Degrees of freedom: numbers read less what the start takes of them.
    pub degrees: usize,
}

impl Absolute {
    pub(super) fn of(alone: &Likelihood, determined: f64) -> Self {
        let degrees = (alone.numbers as f64 - determined).max(1.0);
        let count = u32::try_from(degrees as u64).unwrap_or(u32::MAX);
        let band = |p: f64| chi_squared_quantile(p, count) / degrees;
        let squares = if alone.lost { f64::INFINITY } else { alone.chi_squared };
        Self {
            chi_squared_per_degree: squares / degrees,
            band_99: (band(0.005), band(0.995)),
            degrees: degrees as usize,
        }
    }
}

/// What pushes the platform beside its model: torques that come and go with the time of [`whorl_prediction::Disturbance`], as
/// large as makes the run likeliest. Zero where they make it hardly likelier.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unexplained {
    /// Standard deviation about each body axis [N m].
    pub torque_b_n_m: [f64; 3],
    /// Of each wheel's motor about its axis, with its wheel's name [N m].
    pub motors_n_m: Vec<(String, f64)>,
}

impl Unexplained {
    pub(super) fn of(case: &Prepared<'_>, followed: &Followed) -> Self {
        let of = &followed.noise.disturbance;
        let wheels = case.model().wheels().iter().map(|wheel| wheel.name.clone());
        Self {
            torque_b_n_m: of.body_stddev_b_n_m(),
            motors_n_m: wheels.zip(of.motors_n_m.iter().copied()).collect(),
        }
    }

    /// Whether there is any.
    #[must_use]
    pub fn is_some(&self) -> bool {
        self.torque_b_n_m.iter().chain(self.motors_n_m.iter().map(|(_, x)| x)).any(|x| *x > 0.0)
    }
}
