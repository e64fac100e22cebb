//! The continuous state of a platform.

use nalgebra::{UnitQuaternion, Vector3};

use crate::actuators::{Actuators, States};
use crate::effects::MAX_HIDDEN_STATES;

/// The continuous state of a platform. Arrays have fixed sizes so that a step allocates nothing;
/// entries beyond the platform's own wheels and hidden states stay zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Rate of the body seen from the world, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// States of the actuators by kind.
    pub actuators: States,
    /// Hidden states of effects.
    pub hidden: [f64; MAX_HIDDEN_STATES],
}

impl State {
    /// At rest.
    #[must_use]
    pub fn at_rest(q_world_body: UnitQuaternion<f64>, actuators: &Actuators) -> Self {
        Self {
            q_world_body,
            omega_wb_b_rad_s: Vector3::zeros(),
            actuators: actuators.at_rest(),
            hidden: [0.0; MAX_HIDDEN_STATES],
        }
    }

    /// The quaternion back on the sphere.
    pub(crate) fn normalised(mut self) -> Self {
        self.normalise();
        self
    }

    /// Puts the quaternion back on the sphere.
    #[inline]
    pub(crate) fn normalise(&mut self) {
        self.q_world_body = UnitQuaternion::new_normalize(self.q_world_body.into_inner());
    }
}
