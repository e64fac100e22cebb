//! Runs whose body was held.

use whorl_dynamics::PlatformModel;
use whorl_recording::{Mounting, Recording};

/// Whether the body was held.
pub(crate) fn is_clamped(recording: &Recording, model: &PlatformModel) -> bool {
    recording.mounting == Mounting::Clamped || !model.freedom.turns()
}
