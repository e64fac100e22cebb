//! What the samples show directly beside a fit: lines, resonances, vibrations, turning wheels, digits of the gyro, pulses that nobody recorded.

pub(crate) mod digits;
mod fast;
pub(crate) mod lines;
pub(crate) mod observed;
pub(crate) mod readings;
pub(crate) mod seen;
#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_recording::{Mounting, Recording};

pub(crate) use observed::{Observed, observed, remains_of};

/// Whether the body was held.
pub(crate) fn is_clamped(recording: &Recording, model: &PlatformModel) -> bool {
    recording.mounting == Mounting::Clamped || !model.freedom.turns()
}
