//! Attitude and gyro-bias estimation with consistency statistics, and mass properties while a platform moves ([`sequential`]).
//!
//! [`AttitudeBiasEstimator`] is the attitude-error / gyro-bias filter of J. L. Schwartz, *The Distributed
//! Spacecraft Attitude Control System Simulator*, Virginia Tech, 2004, section 4.5.4, as a pure,
//! allocation-free state machine with everything that keeps a filter reliable in operation (`supervision`): gates, start, late
//! samples, restarts, health. [`Estimator`] runs any other algorithm ([`kernels`]) beside it, on the samples that it
//! accepted. [`consistency`] judges any filter (NEES, NIS and their
//! chi-squared bands), and [`steady_state`] gives the accuracy that an optimal filter reaches.
//!
//! Frames, signs and units: see `whorl_math`.

mod body;
pub mod conformance;
pub mod consistency;
mod estimate;
mod estimator;
pub mod kernels;
mod parameters;
mod residual;
pub mod sequential;
pub mod steady_state;
mod supervision;

pub use body::BodyModel;
pub use estimate::{Estimate, Flags, Health};
pub use estimator::{Estimator, EstimatorError};
pub use kernels::FilterKind;
pub use parameters::{
    AccelerationRejection, GyroSampling, ParameterError, Parameters, VectorParameters, VectorUse,
};
pub use supervision::{
    AttitudeBiasEstimator, FilterEvent, ImuOutcome, ImuSample, Rejection, RejectionCounts, SampleOutcome,
};

#[cfg(test)]
mod tests;
