//! The regressions on a recording.

use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use super::{Form, Method, RegressionError, Solution, Weighting, estimated_series, rows, solve};

/// How a recording is regressed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegressionSettings {
    /// Which equations.
    pub method: Method,
    /// Their form.
    pub form: Form,
    /// How they are weighed.
    pub weights: Weights,
    /// Step between equations \[s\], > 0.
    pub step_s: f64,
}

/// How the equations of a recording are weighed; the noise is that of the model's gyro.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weights {
    /// Eq. 4.78.
    PseudoInverse,
    /// Weighted least squares: the error of a row is that of the momentum, the noise of the rate times the inertia.
    Markov,
    /// Total least squares with the noise of the rate.
    Total,
}

/// A regression of one recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Regressed {
    /// Samples of the estimated motion.
    pub samples: usize,
    /// The solution.
    pub solution: Solution,
}

/// Estimates the motion of a recording with the dissertation's filter, and solves its equations.
///
/// # Errors
/// When the recording cannot be used, or the equations have no solution.
pub fn regress(
    run: &Recording,
    model: &PlatformModel,
    settings: &RegressionSettings,
) -> Result<Regressed, RegressionError> {
    let series = estimated_series(run, model, settings.step_s)?;
    let gyro = model.sensors.gyro.errors.noise_stddev;
    let inertia = model.mass_properties.inertia_b_kg_m2().diagonal();
    let weighting = match settings.weights {
        Weights::PseudoInverse => Weighting::PseudoInverse,
        Weights::Markov => Weighting::Markov { row_stddev: inertia.component_mul(&gyro).into() },
        Weights::Total => Weighting::TotalLeastSquares { rate_stddev_rad_s: gyro.amax() },
    };
    let solution = solve(&rows(&series, settings.method, settings.form), weighting)?;
    Ok(Regressed { samples: series.samples.len(), solution })
}
