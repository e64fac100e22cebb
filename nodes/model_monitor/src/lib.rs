//! Says whether one platform still moves as its model says, while it moves.
//!
//! Reads what is measured and what the actuators did, and publishes `model/fit`. The method: `whorl_monitoring`.

mod core;
pub mod parameters;

pub use crate::core::ModelMonitorCore;
pub use parameters::Parameters;
