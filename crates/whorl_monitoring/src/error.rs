//! Why a platform cannot be watched.

use thiserror::Error;
use whorl_dynamics::{GyrostatError, PlantError};

/// Why a platform cannot be watched.
#[derive(Debug, Error)]
pub enum MonitorError {
    /// Its model cannot be simulated.
    #[error(transparent)]
    Model(#[from] GyrostatError),
    /// Its plant cannot be put into motion.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// It has motors whose states the monitor does not follow.
    #[error("the model has motors of another kind ({what}): only wheels and jets are watched")]
    OtherActuators {
        /// Their kind.
        what: String,
    },
}
