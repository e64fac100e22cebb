//! Attitude, rate, wheel speeds and sensor biases from all of a recording's data.
//!
//! The start of every prediction. **Attitude** comes from gyro, accelerometer and vector sensors of the
//! whole run (forward filter and backward smoother), without the model's torques: an error of the
//! model cannot hide in it. **Rate and wheel speeds** are the measured ones less what the model explains
//! of their change, averaged over half a second to either side. [`start_attitude`] and [`pull`] are the rough first
//! attitude of those who linearise about a motion and smooth it themselves.

mod attitude;
mod backward;
mod motion;
mod sensors;
mod start;

pub use attitude::{Attitudes, smooth_attitude};
pub(crate) use backward::back;
pub use motion::{HALF_WIDTH_S, Motion, SmoothedMotion, smooth};
pub use start::{pull, start_attitude};
