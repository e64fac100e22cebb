//! Why a recording cannot be predicted.

use crate::refusal::Refusal;
use thiserror::Error;
use whorl_dynamics::{GyrostatError, PlantError};

/// Why a recording cannot be predicted.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PredictionError {
    /// The model cannot be simulated.
    #[error("the model cannot be simulated: {0}")]
    Model(#[from] GyrostatError),
    /// The plant refused its start.
    #[error("the model cannot be simulated: {0}")]
    Plant(#[from] PlantError),
    /// The recording is of another platform: it has other numbers of wheels, gyros or jets.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// No platform has the parameters with which a fit was to begin, or any close by.
    #[error(
        "no platform has the parameters with which the fit begins: a mass or an inertia that no body has"
    )]
    NoModel,
    /// Nothing that the model predicts was recorded.
    #[error(
        "{run}: nothing was recorded that the model predicts: no rate, force, direction or wheel speed with its command"
    )]
    NothingToPredict {
        /// Name of the run.
        run: String,
    },
    /// A sensor was recorded that has no noise.
    #[error(
        "{run}: {channel} was recorded, and its noise is stated as zero; state in the platform's file what one sample scatters by"
    )]
    NoNoise {
        /// Name of the run.
        run: String,
        /// Which component of which channel.
        channel: String,
    },
}
