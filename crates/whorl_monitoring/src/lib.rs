//! Whether a platform still moves as its model says, while it moves.
//!
//! The filter of `whorl_prediction` (its METHOD.md), recursive, over gyro and wheel speeds:
//!
//! 1. The platform's own plant goes through every cell of time (0.2 s) with the torques and pulses that were carried out; the mean of the
//!    readings less their predictions is a reading in its middle (`cells.rs`). The attitude is the estimator's. A cell is
//!    compared when everything about it has arrived; where something is late for good, lost or in disorder the motion is found anew ([`Hole`]).
//! 2. The predictor's gains over rate, wheel speeds, gyro bias and slow torques make innovations of it, and its columns how these change with
//!    the platform's constants and with every effect of the catalogue (`directions.rs`, `watch.rs`). How noisy the motors are is
//!    learned in the first minute (`motors.rs`).
//! 3. Windows of some seconds give sums G = X^T X and g = X^T y, of which those since any earlier window follow; the platform's constants
//!    are integrated out over their priors (`sums.rs`). They give the likelihood ratio of "this effect has begun there" against "the model is
//!    right", with the effect's size integrated out over its prior (`ratio.rs`).
//! 4. The sum of these ratios over starts and effects is the running evidence (`evidence.rs`). While the model is right its mean grows
//!    with the number of starts alone, which bounds the rate of false alarms whatever is looked at and how often
//!    ([`Settings::limit_nats`]).
//!
//! All is pure: time and data are arguments.

mod cells;
mod directions;
mod error;
mod evidence;
mod fit;
mod gas;
mod monitor;
mod motors;
mod ratio;
mod settings;
mod sources;
mod sums;
mod watch;

pub use cells::Supplies;
pub use directions::UNKNOWN_TORQUE;
pub use error::MonitorError;
pub use fit::{Fit, Likeliest, Parameter, State};
pub use monitor::Monitor;
pub use settings::Settings;
pub use sources::{Hole, Source};
