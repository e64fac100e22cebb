//! Whether a platform still moves as its model says, while it moves.
//!
//! 1. What arrives is put in order (`monitor.rs`, `sources.rs`). Where something is late for good, lost or in disorder the motion is found
//!    anew ([`Fit::hole`]). The platform's own plant goes through every cell of 0.2 s with what the actuators did; the mean of the readings
//!    less their predictions is a reading in its middle (`cell.rs`). The attitude is the estimator's.
//! 2. The filter of `whorl_prediction` (its METHOD.md, "As readings arrive") makes innovations of it, over rate, wheel speeds, gyro bias, slow
//!    torques and the platform's constants, and how these change with every effect of the catalogue (`directions.rs`) that began at
//!    one of some starts (`watch.rs`). How noisy the motors are is learned in the first minute.
//! 3. That gives the likelihood ratio of "this effect has begun there" against "the model is right". The sum over starts and effects is
//!    the running evidence (`evidence.rs`). While the model is right its mean grows with the number of starts alone, which bounds the
//!    rate of false alarms whatever is looked at and how often ([`Settings::limit_nats`]).
//!
//! All is pure: time and data are arguments.

mod cell;
mod directions;
mod evidence;
mod fit;
mod monitor;
mod sources;
mod watch;

pub use fit::{Fit, Likeliest, MonitorError, Parameter, Settings, State};
pub use monitor::Monitor;
