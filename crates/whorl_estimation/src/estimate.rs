//! The estimate that the filter publishes.

use nalgebra::{Matrix6, UnitQuaternion, Vector3};

/// Whether the estimate may be used; values as in `whorl_msgs/AttitudeEstimate`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Health {
    /// No attitude yet: the values must not be used.
    Initialising = 0,
    /// All is well.
    Ok = 1,
    /// Usable; the heading is not observed, or a sensor is missing.
    Degraded = 2,
    /// Must not be used.
    Unhealthy = 3,
}

/// Flag bits; values as in `whorl_msgs/AttitudeEstimate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags(pub u32);

impl Flags {
    /// The latest gyro sample was refused.
    pub const GYRO_REJECTED: Self = Self(1);
    /// The latest accelerometer sample was refused.
    pub const ACCELEROMETER_REJECTED: Self = Self(2);
    /// The latest vector sample was refused.
    pub const VECTOR_REJECTED: Self = Self(4);
    /// No accepted vector sample for too long, or no vector sensor.
    pub const VECTOR_STALE: Self = Self(8);
    /// No accepted IMU sample for too long.
    pub const IMU_STALE: Self = Self(16);
    /// The average NIS is above its limit.
    pub const INCONSISTENT: Self = Self(32);

    /// Whether all bits of `flag` are set.
    #[must_use]
    pub fn contains(self, flag: Self) -> bool {
        self.0 & flag.0 == flag.0
    }

    pub(crate) fn set(&mut self, flag: Self, on: bool) {
        if on {
            self.0 |= flag.0;
        }
    }
}

/// The filter's answer at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Stamp of the newest accepted IMU sample \[ns\].
    pub stamp_ns: i64,
    /// Attitude.
    pub q_world_body: UnitQuaternion<f64>,
    /// Rate of the body seen from the world, body axes, bias removed \[rad/s\].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Gyro bias, body axes \[rad/s\].
    pub gyro_bias_b_rad_s: Vector3<f64>,
    /// Covariance of (attitude error in body axes \[rad\], bias error \[rad/s\]), where
    /// `q_true = q_world_body * exp(attitude error)` and `bias_true = bias + bias error`.
    pub covariance: Matrix6<f64>,
    /// Normalised innovation squared of the latest update; `None` if the latest step had none.
    pub nis: Option<f64>,
    /// Its degrees of freedom: 2 for a direction, 1 for a heading, 0 for none.
    pub nis_dof: u8,
    /// Whether the estimate may be used.
    pub health: Health,
    /// Why.
    pub flags: Flags,
    /// Refused samples of all sensors since the start.
    pub rejected_samples: u32,
}
