//! Attitude, rate, wheel speeds and sensor biases from all of a recording's data.
//!
//! These are the initial states of predictions. **Attitude** comes from gyro, accelerometer and vector sensors of the
//! whole run (forward filter and backward smoother), without the model's torques, so a model
//! error cannot be absorbed by it. **Rate and wheel speeds** are the measured ones without the change that the model
//! predicts, averaged over half a second to either side. [`start_attitude`] and [`pull`] give a rough initial attitude
//! to callers that linearise about a motion and smooth it themselves.

mod attitude;
mod backward;
mod motion;
mod sensors;
mod start;

pub use attitude::{Attitudes, smooth_attitude};
pub(crate) use backward::back;
pub use motion::{HALF_WIDTH_S, Motion, SmoothedMotion, smooth};
pub use start::{pull, start_attitude};
