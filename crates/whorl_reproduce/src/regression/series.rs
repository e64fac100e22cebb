//! Estimated motion and known torques, evenly spaced.

use nalgebra::{SMatrix, UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::equation::{mass_regressor, momentum_rate_b_n_m};
use whorl_dynamics::mass_parameters::MASS_PARAMETERS;
use whorl_dynamics::platform::Wheel;
use whorl_math::vertical_b;

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

impl StateSample {
    /// w x I w + mgr x k_b as a matrix times the nine mass parameters (eq. 4.75).
    #[must_use]
    pub fn mass_regressor(&self) -> SMatrix<f64, 3, MASS_PARAMETERS> {
        mass_regressor(&self.omega_wb_b_rad_s, &vertical_b(&self.q_world_body))
    }
}

impl StateSeries {
    /// Torque that the wheels' momentum exerts as the body turns, -w x A I_s w_s [N m].
    #[must_use]
    pub fn gyroscopic_torque_b_n_m(&self, sample: &StateSample) -> Vector3<f64> {
        let momentum = self.wheel_momentum_b_n_m_s(sample);
        momentum_rate_b_n_m(&sample.omega_wb_b_rad_s, &momentum, &Vector3::zeros())
    }

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
