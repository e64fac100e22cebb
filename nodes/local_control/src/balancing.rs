//! Automatic mass balancing while the platform tracks its reference with the wheels.
//!
//! The law is [`whorl_control::mass_balancing`]; here it gets the estimates, and its moment is sent to
//! the linear actuators on `ballast/moment`, repeated every second, because that topic may lose messages.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_control::mass_balancing::{
    Balancer, BalancingError, BalancingInput, BalancingSettings, BalancingState,
};
use whorl_dynamics::Gyrostat;
use whorl_math::vertical_b;
use whorl_node::Timestamp;

use crate::inputs::Estimate;

const REPEAT: Duration = Duration::from_secs(1);

/// Balancing of one platform.
#[derive(Debug)]
pub(crate) struct Balancing {
    balancer: Balancer,
    target: Vector3<f64>,
    model_offset: Vector3<f64>,
    latest_stamp: Option<Timestamp>,
    next_message: Option<Timestamp>,
    balanced: bool,
}

/// Result of a step.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct BalancingOutput {
    /// Moment to send [N m].
    pub moment_b_n_m: Option<Vector3<f64>>,
    /// Something to log.
    pub sentence: Option<String>,
}

impl Balancing {
    pub fn new(settings: BalancingSettings, gyrostat: &Gyrostat) -> Result<Self, BalancingError> {
        let mass = &gyrostat.model().mass_properties;
        let model_offset = *mass.gravity_offset_b_n_m();
        Ok(Self {
            balancer: Balancer::new(settings, *mass.inertia_b_kg_m2(), Vector3::zeros(), model_offset)?,
            target: settings.target_b_n_m,
            model_offset,
            latest_stamp: None,
            next_message: None,
            balanced: false,
        })
    }

    /// The platform is not under control: the current measurement is discarded.
    pub fn interrupt(&mut self) {
        self.balancer.interrupt();
        self.latest_stamp = None;
    }

    /// Torque of the estimated gravity offset beyond the model, body axes [N m].
    pub fn torque_b_n_m(&self, estimate: &Estimate) -> Vector3<f64> {
        let offset = self.balancer.state().residual_b_n_m + self.target;
        -(offset - self.model_offset).cross(&vertical_b(&estimate.q_world_body))
    }

    /// Moment that the actuators should have [N m].
    #[cfg(test)]
    pub fn moment_b_n_m(&self) -> Vector3<f64> {
        self.balancer.state().moment_b_n_m
    }

    /// Processes an estimate.
    pub fn step(
        &mut self,
        now: Timestamp,
        estimate: &Estimate,
        wheel_momentum: &Vector3<f64>,
    ) -> BalancingOutput {
        let dt_s = self.latest_stamp.map_or(1e-3, |latest| estimate.stamp.seconds_since(latest));
        self.latest_stamp = Some(estimate.stamp);
        let state = self.balancer.step(&BalancingInput {
            dt_s,
            q_world_body: estimate.q_world_body,
            omega_wb_b_rad_s: estimate.omega_wb_b_rad_s,
            wheel_momentum_b_n_m_s: *wheel_momentum,
            known_torque_b_n_m: Vector3::zeros(),
        });
        let sentence = state.as_ref().and_then(|state| self.sentence(state));
        let due = state.is_some() || self.next_message.is_none_or(|next| next <= now);
        if due {
            self.next_message = Some(now + REPEAT);
        }
        BalancingOutput { moment_b_n_m: due.then(|| self.balancer.state().moment_b_n_m), sentence }
    }

    /// Logged once, when balance is reached or lost.
    fn sentence(&mut self, state: &BalancingState) -> Option<String> {
        if state.balanced == self.balanced {
            return None;
        }
        self.balanced = state.balanced;
        let milli = |v: &Vector3<f64>| format!("{:.2}, {:.2}, {:.2}", 1e3 * v.x, 1e3 * v.y, 1e3 * v.z);
        Some(if state.balanced {
            format!(
                "balanced: offset within {} N mm (one standard deviation), actuators at {} N mm",
                milli(&state.residual_stddev_n_m),
                milli(&state.moment_b_n_m)
            )
        } else {
            format!("no longer balanced: {} N mm left", milli(&state.residual_b_n_m))
        })
    }
}
