//! Tracks the attitude reference of one platform with wheels and jets.
//!
//! Every attitude estimate triggers one control step: reference extrapolated to the estimate's stamp,
//! tracking law, allocation, actuator command. Responses to missing or invalid inputs:
//!
//! | what happens | what the core does | mode, reason |
//! |---|---|---|
//! | no authority yet, or `STANDBY` | zero command | IDLE, NO_AUTHORITY |
//! | authority expires | reference decelerates to rest, then zero command | HOLD then IDLE, NO_AUTHORITY |
//! | `HOLD` | reference decelerates and is held | HOLD, NONE |
//! | reference not renewed, or none yet | it decelerates and is held | HOLD, REFERENCE_STALE |
//! | reference jumps (a link returned) | it is approached within rate and acceleration limits | TRACK, NONE |
//! | reference too tilted | it is clipped | TRACK, NONE |
//! | an excitation is requested | it is played, added to control or instead of it | TRACK or EXCITE, NONE |
//! | it reaches a limit, or is unknown | it ends; the reference decelerates and is held | HOLD, EXCITATION_* |
//! | estimate stale or not usable | rate damping on the gyro, then coasting | SAFE_*, ESTIMATE_* |
//! | tilt near its stop, rate too high | the same | SAFE_*, TILT_LIMIT, RATE_LIMIT |
//! | `ABORT` | the same, until another command | SAFE_*, ABORT |
//! | gyro missing or frozen in safe mode | coasting | SAFE_COAST |
//! | jet reported failed | allocation without it | |
//! | message not finite, late, duplicate or out of order | dropped and counted | |
//! | the node stops | zero command | |
//!
//! All safe modes but `ABORT` end automatically once the fault has been absent for a while.

mod actuation;
mod authority;
mod balancing;
mod core;
mod diagnostics;
mod excitation;
mod inputs;
pub mod parameters;
mod publishing;
mod target;
#[cfg(test)]
mod tests;

pub use crate::core::{LocalControlCore, LocalControlError};
pub use parameters::{Excitation, Hold, Limits, Parameters};
