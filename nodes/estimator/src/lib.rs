//! Estimates attitude and gyro bias of one platform.
//!
//! Reads `imu/data_raw` and `vector_sensor/direction`, publishes `attitude/estimate` at every IMU
//! sample, and `/tf`. The filter is `whorl_estimation::Filter`.

mod calibration;
mod core;
pub mod parameters;

pub use crate::calibration::Calibration;
pub use crate::core::EstimatorCore;
pub use parameters::Parameters;
