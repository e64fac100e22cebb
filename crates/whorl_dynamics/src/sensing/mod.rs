//! How sensors turn the truth into measurements.
//!
//! The functions here are pure: noise comes in as standard normal numbers.

mod history;
mod low_pass;
mod scalar;
mod skew;
mod triaxial;
mod vector;

pub(crate) use history::{History, Snapshot};
pub use low_pass::low_passed;
pub use skew::{tangled, untangled};

use nalgebra::{Unit, Vector3};
use whorl_math::GRAVITY_M_S2;

/// One sample of the inertial unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Stamp \[ns\]; the data are older by the sensor's latency.
    pub stamp_ns: i64,
    /// Gyro reading, sensor axes nominally along the body's [rad/s].
    pub angular_velocity_rad_s: Vector3<f64>,
    /// Accelerometer reading: specific force, +9.81 on z at rest [m/s^2].
    pub specific_force_m_s2: Vector3<f64>,
}

/// One sample of the vector sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorSample {
    /// Stamp \[ns\]; the data are older by the sensor's latency.
    pub stamp_ns: i64,
    /// Direction to the reference, sensor axes nominally along the body's.
    pub direction: Unit<Vector3<f64>>,
}

/// One sample of a wheel's drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelSample {
    /// Tachometer reading [rad/s].
    pub speed_rad_s: f64,
    /// Torque that the drive was asked for, within its limits [N m].
    pub motor_torque_n_m: f64,
}

/// One sample of the joints of one kind of actuator, in the order of its actuators.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointSample {
    /// Positions \[rad\]; empty when they are not measured.
    pub position_rad: Vec<f64>,
    /// Speeds [rad/s].
    pub velocity_rad_s: Vec<f64>,
    /// Torques that the drives were asked for, within their limits [N m]; empty when they are not known.
    pub effort_n_m: Vec<f64>,
}

/// Specific force at `r` from the centre of rotation, body axes [m/s^2]:
/// dw/dt x r + w x (w x r) + g k_b (eq. 4.40 with the gravity sign of REP-145).
#[must_use]
pub fn specific_force_b_m_s2(
    r_b_m: &Vector3<f64>,
    omega_wb_b_rad_s: &Vector3<f64>,
    omega_dot_wb_b_rad_s2: &Vector3<f64>,
    vertical_b: &Vector3<f64>,
) -> Vector3<f64> {
    omega_dot_wb_b_rad_s2.cross(r_b_m)
        + omega_wb_b_rad_s.cross(&omega_wb_b_rad_s.cross(r_b_m))
        + GRAVITY_M_S2 * vertical_b
}
