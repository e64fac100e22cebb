//! What the samples show directly beside a fit: lines, resonances, vibrations, turning wheels, digits of the gyro, friction of gimbals,
//! pulses that nobody recorded.

pub(crate) mod digits;
mod fast;
pub(crate) mod gimbals;
pub(crate) mod lines;
pub(crate) mod modes;
pub(crate) mod observed;
pub(crate) mod pulses;
pub(crate) mod readings;
mod remains;
pub(crate) mod seen;

use whorl_dynamics::PlatformModel;
use whorl_recording::{Mounting, Recording};

pub(crate) use observed::{Observed, observed};

/// What is left of all runs.
pub(crate) fn remains_of(observed: &[Observed<'_>]) -> remains::Remains {
    observed.iter().fold(remains::Remains::default(), |all, run| all.and(run.remains))
}

/// Whether the body was held.
pub(crate) fn is_clamped(recording: &Recording, model: &PlatformModel) -> bool {
    recording.mounting == Mounting::Clamped || !model.freedom.turns()
}
