//! Attitude and gyro-bias estimation with consistency statistics.
//!
//! [`Filter`] is the attitude-error / gyro-bias filter of J. L. Schwartz, *The Distributed
//! Spacecraft Attitude Control System Simulator*, Virginia Tech, 2004, section 4.5.4, as a pure,
//! allocation-free state machine. [`consistency`] judges any filter (NEES, NIS and their
//! chi-squared bands), and [`steady_state`] gives the accuracy that an optimal filter reaches.
//!
//! Frames, signs and units: see `whorl_math`.

mod body;
pub mod consistency;
mod covariance;
mod estimate;
mod filter;
pub mod filters;
pub mod free_motion;
mod gravity_window;
mod history;
mod monitor;
pub mod orientation_error;
mod parameters;
mod residual;
mod start;
pub mod steady_state;
mod verdict;

pub use body::BodyModel;
pub use estimate::{Estimate, Flags, Health};
pub use filter::{Filter, ImuSample};
pub use filters::{Estimator, EstimatorError, FilterKind};
pub use parameters::{
    AccelerationRejection, GyroSampling, ParameterError, Parameters, VectorParameters, VectorUse,
};
pub use verdict::{FilterEvent, ImuOutcome, Rejection, RejectionCounts, Verdict};

#[cfg(test)]
mod tests;
