//! Automatic mass balancing while the platform tracks its reference with the wheels.
//!
//! The law is [`whorl_control::mass_balancing`]; here it gets the estimates, and its moment is sent to
//! the linear actuators on `ballast/moment`, repeated every second, because that topic may lose messages.
//!
//! What is sent is where the masses of the platform's file can be by then, at their largest speed, ten times a second while
//! they travel: a recording then has the way, not only where it led. No window is measured meanwhile.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_control::mass_balancing::{
    Balancer, BalancingError, BalancingInput, BalancingSettings, BalancingState,
};
use whorl_dynamics::Gyrostat;
use whorl_dynamics::actuators::moving_masses::MovingMasses;
use whorl_math::vertical_b;
use whorl_node::Timestamp;

use crate::inputs::Estimate;

const REPEAT: Duration = Duration::from_secs(1);
/// Between messages while the masses travel.
const TRAVEL: Duration = Duration::from_millis(100);
/// Distance from where they are sent at which they have arrived [N m]: rounding.
const ARRIVED_N_M: f64 = 1e-9;

/// Balancing of one platform.
#[derive(Debug)]
pub(crate) struct Balancing {
    balancer: Balancer,
    masses: MovingMasses,
    /// Moment sent last, or to be sent next: on the way to the balancer's [N m].
    sent: Vector3<f64>,
    target: Vector3<f64>,
    model_offset: Vector3<f64>,
    latest_stamp: Option<Timestamp>,
    next_message: Option<Timestamp>,
    balanced: bool,
    at_limit: [bool; 3],
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
        let masses = gyrostat.model().moving_masses().clone();
        let model_offset = *mass.gravity_offset_b_n_m();
        Ok(Self {
            balancer: Balancer::new(settings, *mass.inertia_b_kg_m2(), Vector3::zeros(), model_offset)?
                .with_masses(masses.clone()),
            masses,
            sent: Vector3::zeros(),
            target: settings.target_b_n_m,
            model_offset,
            latest_stamp: None,
            next_message: None,
            balanced: false,
            at_limit: [false; 3],
        })
    }

    /// The platform is not under control: the current measurement is discarded.
    pub fn interrupt(&mut self) {
        self.balancer.interrupt();
        self.latest_stamp = None;
    }

    /// Torque of the estimated gravity offset beyond the model, body axes [N m].
    pub fn torque_b_n_m(&self, estimate: &Estimate) -> Vector3<f64> {
        let state = self.balancer.state();
        let offset = state.residual_b_n_m + self.target + (self.sent - state.moment_b_n_m);
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
        if self.travel(dt_s) {
            return BalancingOutput { moment_b_n_m: self.message(now, TRAVEL, false), sentence: None };
        }
        let state = self.balancer.step(&BalancingInput {
            dt_s,
            q_world_body: estimate.q_world_body,
            omega_wb_b_rad_s: estimate.omega_wb_b_rad_s,
            wheel_momentum_b_n_m_s: *wheel_momentum,
            known_torque_b_n_m: Vector3::zeros(),
        });
        let sentence = state.as_ref().and_then(|state| self.sentence(state));
        if self.masses.0.is_empty() {
            self.sent = self.balancer.state().moment_b_n_m;
        }
        BalancingOutput { moment_b_n_m: self.message(now, REPEAT, state.is_some()), sentence }
    }

    /// Moves the masses on; false when they are where they shall be.
    fn travel(&mut self, dt_s: f64) -> bool {
        let to = self.balancer.state().moment_b_n_m;
        if self.sent == to {
            return false;
        }
        self.balancer.interrupt();
        self.sent = self.masses.on_the_way(&self.sent, &to, dt_s);
        if (self.sent - to).amax() < ARRIVED_N_M {
            self.sent = to;
            // The last message of the way is due now.
            self.next_message = None;
        }
        true
    }

    /// The moment to send when a message is due.
    fn message(&mut self, now: Timestamp, period: Duration, at_once: bool) -> Option<Vector3<f64>> {
        let due = at_once || self.next_message.is_none_or(|next| next <= now);
        if due {
            self.next_message = Some(now + period);
        }
        due.then_some(self.sent)
    }

    /// Logged once, when balance is reached or lost, or an end stop.
    fn sentence(&mut self, state: &BalancingState) -> Option<String> {
        if state.balanced == self.balanced {
            if state.at_limit == self.at_limit {
                return None;
            }
            self.at_limit = state.at_limit;
            let axes = ["x", "y", "z"].into_iter().zip(state.at_limit).zip(&state.residual_b_n_m);
            let left: Vec<String> = axes
                .filter(|((_, limited), _)| *limited)
                .map(|((axis, _), left)| format!("{:.2} N mm along {axis}", 1e3 * left))
                .collect();
            return (!left.is_empty()).then(|| {
                format!(
                    "the linear actuators cannot balance {}: at the end of their travel, or none there; move ballast by hand, or see balancing.limit_n_m and model.moving_masses",
                    left.join(", ")
                )
            });
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
