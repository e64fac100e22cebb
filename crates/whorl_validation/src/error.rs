//! Why a recording cannot be compared with a model.

use thiserror::Error;
use whorl_prediction::PredictionError;
use whorl_prediction::Refusal;

/// Why a recording cannot be compared with a model, with advice.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ValidationError {
    /// The recording cannot be used.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// The residual torque is too short for a regression.
    #[error("{run}: {given} values of the residual torque are too few; record a longer run")]
    TooShort {
        /// Names of the runs.
        run: String,
        /// Values given.
        given: usize,
    },
    /// The motion of the model does not stay finite.
    #[error(
        "{run}: the model's motion is lost in this run: a number of its file is off by far, or a channel has another unit"
    )]
    Lost {
        /// Name of the run.
        run: String,
    },
    /// The recording cannot be predicted with the model.
    #[error(transparent)]
    Prediction(#[from] PredictionError),
}
