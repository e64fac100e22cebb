//! Mass properties, sensor calibration, balancing and the design of experiments that determine them.
//!
//! [`identify`] is the method to use: the likelihood of the readings, with priors, and with a consistent uncertainty.
//!
//! Source of names and equation numbers: J. L. Schwartz, *The Distributed Spacecraft Attitude Control
//! System Simulator*, Ph.D. dissertation, Virginia Tech, 2004, sections 4.2-4.4 and 4.6. Where its
//! equations are in error the module says so; `docs/errata.md` has the list.
//!
//! Frames, signs and units: see `whorl_math`.

pub mod balance;
pub mod calibration;
mod finding;
mod identification;
pub mod mass_parameters;
pub mod realisability;
pub mod sequential;
#[cfg(test)]
mod tests;

pub use finding::{DataError, Finding};
pub use identification::{
    Determined, FittedParameter, Identification, UpdateError, identify, predict, usable_readings,
};
pub use mass_parameters::{MassCovariance, MassVector};
pub use whorl_prediction::Settings;
