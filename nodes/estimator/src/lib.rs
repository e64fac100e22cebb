//! Estimates attitude and gyro bias of one platform.
//!
//! Reads `imu/data_raw` and `vector_sensor/direction`, publishes `attitude/estimate` at every IMU
//! sample, and `/tf`. The filter is any of `whorl_estimation::FilterKind`. If asked to (`identification.enabled`), mass
//! properties as well, on `parameters/estimate`.

mod calibration;
mod core;
mod identifying;
pub mod parameters;
mod stored;

pub use crate::calibration::Calibration;
pub use crate::core::EstimatorCore;
pub use crate::identifying::Identification;
pub use parameters::Parameters;
