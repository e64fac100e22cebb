//! Whether a platform still moves as its model says, while it moves.
//!
//! A recursive form of the regression of `whorl_identification` (its METHOD.md), over gyro and wheel speeds:
//!
//! 1. Every bin (0.2 s) is predicted by the platform's own plant code with the torques and pulses that were carried out,
//!    from the best estimate at its start; the attitude is the estimator's ([`predictor`]). It is predicted when everything
//!    about it has arrived; where something is late for good, lost or in disorder the motion is found anew ([`Hole`]).
//! 2. A Kalman filter over rate, wheel speeds, gyro bias, a slow background torque and the platform's own constants
//!    (the base columns of the diagnosis, with their priors) turns prediction errors into innovations of unit variance,
//!    y ([`filter`]). How noisy the motors are is learned in the first minute ([`motors`]).
//! 3. The change of y per unit of every effect of the catalogue passes through the same gains, from each of several
//!    starts on: x. Sums of x x^T and x y give the likelihood ratio of "this effect has begun there" against "the model
//!    is right", with the effect's size integrated out over its prior ([`evidence`]).
//! 4. The sum of these ratios over starts and effects is the running evidence. While the model is right its mean grows
//!    with the number of starts alone, which bounds the rate of false alarms whatever is looked at and how often
//!    ([`Settings::limit_nats`]).
//!
//! All is pure: time and data are arguments.

pub mod evidence;
pub mod filter;
mod fit;
mod gas;
pub mod lanes;
mod monitor;
pub mod motors;
mod passing;
pub mod places;
pub mod predictor;
mod ratio;
mod settings;
mod sources;

pub use fit::{Fit, Likeliest, Parameter, State};
pub use monitor::{Monitor, MonitorError};
pub use settings::Settings;
pub use sources::{Hole, Source};
