//! Estimated motion and known torques, evenly spaced.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::platform::Wheel;

/// One time.
#[derive(Debug, Clone, PartialEq)]
pub struct StateSample {
    /// Time \[s\].
    pub time_s: f64,
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
    /// Known external torque until the next sample, body axes [N m].
    pub external_torque_b_n_m: Vector3<f64>,
}

/// Motion over a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StateSeries {
    /// Samples in order of time.
    pub samples: Vec<StateSample>,
    /// A I_s of eq. 4.9: momentum per speed of each wheel; empty for a rigid body.
    pub wheel_momentum_b_kg_m2: Vec<Vector3<f64>>,
}

impl StateSeries {
    /// Momentum of the wheels relative to the body at a sample [N m s].
    #[must_use]
    pub fn wheel_momentum_b_n_m_s(&self, sample: &StateSample) -> Vector3<f64> {
        self.wheel_momentum_b_kg_m2.iter().zip(&sample.wheel_speed_rad_s).map(|(a, s)| a * *s).sum()
    }

    /// A I_s of these wheels.
    #[must_use]
    pub fn momentum_axes(wheels: &[Wheel]) -> Vec<Vector3<f64>> {
        wheels.iter().map(|w| w.spin_axis_b.into_inner() * w.spin_inertia_kg_m2).collect()
    }
}
