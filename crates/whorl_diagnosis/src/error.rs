//! Why recordings cannot be explained.

use thiserror::Error;
use whorl_dynamics::{EffectError, GyrostatError};

/// Why recordings cannot be explained, and what would help.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DiagnosisError {
    /// None was given.
    #[error("no recording was given; name at least one run")]
    NoRecording,
    /// Too little time.
    #[error(
        "{run}: {duration_s:.1} s of data are too short to tell effects apart; record at least {needed_s:.0} s"
    )]
    TooShort {
        /// Name of the run.
        run: String,
        /// Length \[s\].
        duration_s: f64,
        /// Shortest length accepted \[s\].
        needed_s: f64,
    },
    /// A channel that every fit needs is missing.
    #[error("{run}: there are no {channel} data; {help}")]
    MissingChannel {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: &'static str,
        /// What would help.
        help: &'static str,
    },
    /// A channel never changes.
    #[error(
        "{run}: the {channel} never changes: it is frozen, or not this platform's; check the sensor and the channel's name"
    )]
    Constant {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: String,
    },
    /// Data of another platform.
    #[error("{run}: {what}: these are data of another platform, or the model is; check --model")]
    OtherPlatform {
        /// Name of the run.
        run: String,
        /// What does not fit.
        what: String,
    },
    /// Readings that no motion of the platform can give.
    #[error("{run}: {what}; {help}")]
    Implausible {
        /// Name of the run.
        run: String,
        /// What is wrong.
        what: String,
        /// What would help.
        help: &'static str,
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
