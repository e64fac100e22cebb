//! What the samples show directly beside a fit: lines, resonances, vibrations, turning wheels, digits of the gyro, friction of gimbals,
//! pulses that nobody recorded.

pub(crate) mod clamped;
pub(crate) mod digits;
mod fast;
pub(crate) mod gimbals;
mod imbalance;
mod line;
pub(crate) mod lines;
pub(crate) mod modes;
pub(crate) mod observed;
mod pulse_answers;
pub(crate) mod pulses;
pub(crate) mod readings;
mod remains;
pub(crate) mod seen;
pub(crate) mod spectrum;

pub(crate) use observed::{Observed, observed};

/// What is left of all runs.
pub(crate) fn remains_of(observed: &[Observed<'_>]) -> remains::Remains {
    observed.iter().fold(remains::Remains::default(), |all, run| all.and(run.remains))
}
