//! Why recordings cannot be explained.

use thiserror::Error;
use whorl_dynamics::{EffectError, GyrostatError};
use whorl_trajectory::Refusal;

/// Why recordings cannot be explained, and what would help.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DiagnosisError {
    /// None was given.
    #[error("no recording was given; name at least one run")]
    NoRecording,
    /// The recording cannot be used.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Data of another platform.
    #[error("{run}: {what}: these are data of another platform, or the model is; check --model")]
    OtherPlatform {
        /// Name of the run.
        run: String,
        /// What does not fit.
        what: String,
    },
    /// Not in the catalogue.
    #[error("there is no effect \"{id}\"; `whorl effects` lists them")]
    UnknownEffect {
        /// The name given.
        id: String,
    },
    /// The data ask for it with the wrong sign, or hold nothing that could show it.
    #[error("{id} explains nothing in these recordings: its best size is zero, or its channels are missing")]
    NoEffect {
        /// The effect.
        id: String,
    },
    /// The model cannot exist.
    #[error(transparent)]
    Model(#[from] GyrostatError),
    /// An effect of the model cannot exist.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// Numerical trouble.
    #[error(
        "{run}: the motion cannot be reconstructed from the data ({what}); check units, axes and time stamps"
    )]
    NoTrajectory {
        /// Name of the run.
        run: String,
        /// What failed.
        what: &'static str,
    },
}
