//! The continuous state of a platform.

use nalgebra::{UnitQuaternion, Vector3};

use super::Derivative;
use crate::actuators::wheels::MAX_WHEELS;
use crate::effects::MAX_HIDDEN_STATES;

/// The continuous state of a platform. Arrays have fixed sizes so that a step allocates nothing;
/// entries beyond the platform's own wheels and hidden states stay zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Rate of the body seen from the world, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds relative to the body [rad/s].
    pub wheel_speed_rad_s: [f64; MAX_WHEELS],
    /// Gas in the tank \[kg\].
    pub gas_kg: f64,
    /// Hidden states of effects.
    pub hidden: [f64; MAX_HIDDEN_STATES],
}

impl State {
    /// At rest with stopped wheels.
    #[must_use]
    pub fn at_rest(q_world_body: UnitQuaternion<f64>, gas_kg: f64) -> Self {
        Self {
            q_world_body,
            omega_wb_b_rad_s: Vector3::zeros(),
            wheel_speed_rad_s: [0.0; MAX_WHEELS],
            gas_kg,
            hidden: [0.0; MAX_HIDDEN_STATES],
        }
    }

    /// This state moved along `derivative` for `dt_s`. The quaternion is not normalised: the
    /// stages of a Runge-Kutta step leave the sphere by design, its end is normalised.
    pub(crate) fn moved(&self, derivative: &Derivative, dt_s: f64, wheels: usize, hidden: usize) -> Self {
        let mut moved = *self;
        moved.q_world_body =
            UnitQuaternion::new_unchecked(self.q_world_body.into_inner() + derivative.quaternion * dt_s);
        moved.omega_wb_b_rad_s += derivative.omega * dt_s;
        for (speed, rate) in moved.wheel_speed_rad_s.iter_mut().zip(&derivative.wheel_speed).take(wheels) {
            *speed += rate * dt_s;
        }
        moved.gas_kg += derivative.gas * dt_s;
        for (x, rate) in moved.hidden.iter_mut().zip(&derivative.hidden).take(hidden) {
            *x += rate * dt_s;
        }
        moved
    }

    /// The quaternion back on the sphere.
    pub(crate) fn normalised(mut self) -> Self {
        self.q_world_body = UnitQuaternion::new_normalize(self.q_world_body.into_inner());
        self
    }
}
