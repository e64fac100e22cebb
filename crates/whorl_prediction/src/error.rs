//! Why a recording cannot be predicted.

use thiserror::Error;
use whorl_dynamics::{GyrostatError, PlantError};
use whorl_recording::Refusal;

/// Why a recording cannot be predicted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PredictionError {
    /// The model cannot be simulated.
    #[error("the model cannot be simulated: {0}")]
    Model(#[from] GyrostatError),
    /// The plant refused its start.
    #[error("the model cannot be simulated: {0}")]
    Plant(#[from] PlantError),
    /// The recording is of another platform, or shows nothing of it.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// No platform has the parameters with which a fit was to begin, or any close by.
    #[error(
        "no platform has the parameters with which the fit begins: a mass or an inertia that no body has"
    )]
    NoModel,
}
