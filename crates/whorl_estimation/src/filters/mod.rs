//! The filters that can be chosen, behind one interface.
//!
//! A [`Kernel`] is one algorithm: it steps with a good sample and corrects with a direction, and knows
//! nothing of gates, lateness or health. [`Estimator`] runs a kernel beside the gyro-bias filter
//! [`crate::Filter`], which gates the samples for it, finds its first attitude and judges health.

mod attitude_rate;
mod bias_state;
#[cfg(test)]
mod consistency_tests;
mod dense;
mod estimator;
mod free_motion;
mod gyrostat;
mod invariant;
mod iterated;
mod quaternion_rate;
mod rigid_body;
#[cfg(test)]
mod tests;
mod unscented;

pub use attitude_rate::AttitudeRateFilter;
pub use estimator::{Estimator, EstimatorError};
pub use free_motion::FreeMotionKernel;
pub use gyrostat::GyrostatFilter;
pub use invariant::InvariantFilter;
pub use iterated::IteratedFilter;
pub use quaternion_rate::QuaternionRateFilter;
pub use unscented::UnscentedFilter;

use nalgebra::{Matrix6, Unit, UnitQuaternion, Vector3};

/// Which filter makes the estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FilterKind {
    /// Attitude error and gyro bias (dissertation 4.5.4): [`crate::Filter`]. Needs no model of the body.
    #[default]
    AttitudeBias,
    /// Attitude error, momentum, gyro bias, torque and accelerometer bias of a gyrostat:
    /// [`GyrostatFilter`] (4.5.3 with wheels).
    Gyrostat,
    /// Quaternion and rate (4.5.2): [`QuaternionRateFilter`].
    QuaternionRate,
    /// Attitude error and rate (4.5.3): [`AttitudeRateFilter`].
    AttitudeRate,
    /// Attitude error and gyro bias, iterated update: [`IteratedFilter`].
    Iterated,
    /// Attitude error and gyro bias, sigma points (USQUE): [`UnscentedFilter`].
    Unscented,
    /// Attitude and gyro bias, equivariant: [`InvariantFilter`].
    Invariant,
    /// A sensor that moves freely, the vector sensor its magnetometer: [`crate::free_motion`].
    FreeMotion,
}

impl FilterKind {
    /// All of them, with their parameter names.
    pub const ALL: [(&'static str, Self); 8] = [
        ("attitude_bias", Self::AttitudeBias),
        ("gyrostat", Self::Gyrostat),
        ("quaternion_rate", Self::QuaternionRate),
        ("attitude_rate", Self::AttitudeRate),
        ("iterated", Self::Iterated),
        ("unscented", Self::Unscented),
        ("invariant", Self::Invariant),
        ("free_motion", Self::FreeMotion),
    ];

    /// The kind of that name.
    #[must_use]
    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, kind)| *kind)
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Whether it needs a [`crate::BodyModel`].
    #[must_use]
    pub fn needs_body(self) -> bool {
        matches!(self, Self::Gyrostat | Self::QuaternionRate | Self::AttitudeRate)
    }
}

/// One accepted inertial sample, and what acted on the body since the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterStep {
    /// Time since the previous sample \[s\], above zero.
    pub dt_s: f64,
    /// Rate gyro at the end of the step, body axes [rad/s].
    pub gyro_rad_s: Vector3<f64>,
    /// Rate gyro at its begin [rad/s].
    pub gyro_before_rad_s: Vector3<f64>,
    /// Specific force at its end, body axes [m/s^2]; `None` if it was refused.
    pub force_b_m_s2: Option<Vector3<f64>>,
    /// Momentum of the wheels relative to the body at its end, body axes [N m s].
    pub wheel_momentum_b_n_m_s: Vector3<f64>,
    /// Angular impulse of the jets within it, body axes [N m s].
    pub jet_impulse_b_n_m_s: Vector3<f64>,
}

/// What a kernel starts from, and what it says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Attitude.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate, body axes [rad/s].
    pub omega_rad_s: Vector3<f64>,
    /// Gyro bias [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// As [`crate::Estimate::covariance`].
    pub covariance: Matrix6<f64>,
    /// Momentum of the wheels relative to the body, body axes [N m s].
    pub wheel_momentum_b_n_m_s: Vector3<f64>,
}

/// How well measurements agreed with the prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Update {
    /// Normalised innovation squared.
    pub nis: f64,
    /// Its degrees of freedom; 0: there was no measurement.
    pub dof: u8,
}

/// One filter algorithm.
pub trait Kernel {
    /// Moves the estimate to the end of the step.
    fn step(&mut self, step: &FilterStep) -> Update;

    /// Whether [`Self::step`] uses the specific force itself, with its lever arm. If not, the vertical comes through
    /// [`Self::correct_direction`], averaged over the accelerometer's window.
    fn takes_raw_force(&self) -> bool {
        false
    }

    /// Corrects with a direction measured in the body axes of now; `variance` is per axis across it \[rad^2\].
    fn correct_direction(
        &mut self,
        direction_b: &Unit<Vector3<f64>>,
        reference_w: &Unit<Vector3<f64>>,
        variance: f64,
    ) -> Update;

    /// The estimate of now.
    fn solution(&self) -> Solution;
}
