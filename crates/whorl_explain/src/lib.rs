//! Explains data: functions of a [`Case`] (runs of one platform, its model, and the model's prior) with typed results.
//!
//! | question | function | answer |
//! |---|---|---|
//! | how far off is the model? | [`compare`] | a [`ComparedRun`] for each run |
//! | where does it fail? | [`locate`] | [`Located`] |
//! | which effect is missing? | [`diagnose`] | [`Explanation`] |
//! | which manoeuvre is most informative? | [`propose()`] | [`Proposal`] |
//! | how much does an effect improve the model? | [`adopt()`] | [`Adoption`] |
//! | what changed from run to run? | [`trends::trends`] | [`trends::Trends`] |
//!
//! Nothing here reads or writes files or prints. A number with the same name is the same statistic everywhere: all report the [`prediction_error`].

pub mod adopt;
pub mod changes;
mod diagnose;
pub mod propose;
#[cfg(test)]
mod tests;
pub mod trends;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_identification::DiagnosisError;
use whorl_prediction::PredictionError;
use whorl_recording::Recording;

pub use adopt::{Adoption, ComparedRun, Version, adopt, compare, prediction_error};
pub use diagnose::{Explanation, Located, diagnose, locate};
pub use propose::{Proposal, propose};

/// Runs of one platform with its model.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// Training runs: used to fit.
    pub training: &'a [Recording],
    /// Held-out runs: used to test, never to fit.
    pub held_out: &'a [Recording],
    /// The model of the platform, including adopted effects.
    pub model: &'a PlatformModel,
    /// The prior: how well the model is known.
    pub prior: &'a ModelPrior,
}

/// Receives the progress (0 to 1) and the current step of a long computation.
pub type ProgressCallback<'a> = dyn FnMut(f64, &str) + 'a;

/// Why data cannot be explained, and what would help.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExplainError {
    /// A recording cannot be compared with the model.
    #[error(transparent)]
    Prediction(#[from] PredictionError),
    /// The recordings cannot be diagnosed.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// Too few runs, a version that cannot be fitted, no manoeuvre that is possible.
    #[error("{0}")]
    Refused(String),
}
