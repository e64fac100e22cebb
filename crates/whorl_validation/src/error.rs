//! Why a recording cannot be compared with a model.

use thiserror::Error;
use whorl_dynamics::{GyrostatError, PlantError};

/// Why a recording cannot be compared with a model, and what would help.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ValidationError {
    /// A channel without which nothing can be said.
    #[error("{run}: there are no {channel} data; {help}")]
    MissingChannel {
        /// Name of the run.
        run: String,
        /// Which channel.
        channel: &'static str,
        /// What would help.
        help: &'static str,
    },
    /// Too little time.
    #[error("{run}: {duration_s:.1} s of data are too short; record at least {needed_s:.0} s")]
    TooShort {
        /// Name of the run.
        run: String,
        /// Length \[s\].
        duration_s: f64,
        /// Shortest length accepted \[s\].
        needed_s: f64,
    },
    /// The model has another number of wheels than the data.
    #[error(
        "{run}: {given} wheels in the data, {wheels} in the model: data of another platform, or the wrong --model"
    )]
    WheelCount {
        /// Name of the run.
        run: String,
        /// Wheels in the data.
        given: usize,
        /// Wheels of the model.
        wheels: usize,
    },
    /// The model has another number of jets than the data.
    #[error(
        "{run}: {given} jets in the data, {jets} in the model: data of another platform, or the wrong --model"
    )]
    JetCount {
        /// Name of the run.
        run: String,
        /// Jets in the data.
        given: usize,
        /// Jets of the model.
        jets: usize,
    },
    /// A reading that cannot be of this platform.
    #[error("{run}: {what}; {help}")]
    Implausible {
        /// Name of the run.
        run: String,
        /// What is wrong.
        what: String,
        /// What would help.
        help: &'static str,
    },
    /// The model cannot exist.
    #[error("the model cannot be simulated: {0}")]
    Model(#[from] GyrostatError),
    /// The model cannot be simulated.
    #[error("the model cannot be simulated: {0}")]
    Plant(#[from] PlantError),
}
