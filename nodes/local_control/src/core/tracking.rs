//! Pointing: a reference is tracked, or an excitation played.

use nalgebra::Vector3;
use whorl_control::reference::Reference;
use whorl_control::tracking::TrackingInput;
use whorl_msgs::whorl::{AttitudeReference, ControlStatus};
use whorl_node::{Outputs, Timestamp};

use super::LocalControlCore;
use crate::actuation::Actuated;
use crate::authority::Authority;
use crate::excitation::{Drive, Played, tilted_as};
use crate::inputs::Estimate;
use crate::parameters::Hold;
use crate::publishing::Report;
use crate::target::Goal;

impl LocalControlCore {
    pub(super) fn leave_tracking(&mut self) {
        self.law.reset();
        self.target.reset();
        if self.excitations.interrupt() {
            self.actuation.end_excitation();
        }
        if let Some(balancing) = &mut self.balancing {
            balancing.interrupt();
        }
    }

    /// The excitation to play in this step, if any, and the number of its pulse.
    fn played(&mut self, estimate: &Estimate, authority: Authority) -> (Played, Option<u64>) {
        let asked = self.inputs.excitation(estimate.stamp).filter(|_| authority == Authority::Track);
        let Some((name, elapsed_s)) = asked else {
            if self.excitations.stop() {
                self.actuation.end_excitation();
            }
            return (Played::Nothing, None);
        };
        let wheels = self.gyrostat.model().wheels();
        let speeds = self.inputs.wheel_speed_rad_s();
        let known = &self.parameters.excitations;
        let played = self.excitations.play((&name, elapsed_s), known, wheels, speeds, estimate);
        if matches!(played, (Played::Refused(_), _)) {
            self.actuation.end_excitation();
        }
        played
    }

    fn excite(
        &mut self,
        estimate: &Estimate,
        torque_b_n_m: Option<&Vector3<f64>>,
        drive: &Drive,
        pulse: Option<u64>,
    ) -> Actuated {
        let (joints, failed) = (self.inputs.joints(), self.inputs.jet_failed());
        let (actuated, slot_began) =
            self.actuation.excite(estimate.stamp, torque_b_n_m, drive, joints, failed);
        if slot_began {
            self.excitations.fired(pulse);
        }
        actuated
    }

    /// An excitation during which the reference, or its yaw, is not tracked.
    fn let_go(
        &mut self,
        now: Timestamp,
        estimate: &Estimate,
        drive: &Drive,
        pulse: Option<u64>,
        outputs: &mut Outputs,
    ) {
        // Afterwards the reference is approached from the body's attitude at that time.
        self.target.reset();
        if let Some(balancing) = &mut self.balancing {
            balancing.interrupt();
        }
        let tracking = match drive.hold {
            Hold::Tilt => {
                let wheel_momentum = self.actuation.stored_momentum_b_n_m_s(self.inputs.joints());
                let mut output = self.law.torque(&TrackingInput {
                    q_world_body: &estimate.q_world_body,
                    omega_wb_b_rad_s: &estimate.omega_wb_b_rad_s,
                    reference: &tilted_as(&drive.start, estimate),
                    wheel_momentum_b_n_m_s: &wheel_momentum,
                    modelled_torque_b_n_m: &self.modelled_torque(estimate),
                    dt_s: self.step_length_s(now),
                });
                // Yaw gets only the excitation, without feed-forward.
                let up = estimate.q_world_body.inverse() * Vector3::z();
                output.torque_b_n_m -= up * up.dot(&output.torque_b_n_m);
                Some(output)
            }
            Hold::Attitude | Hold::Nothing => {
                self.law.reset();
                None
            }
        };
        let effects = self.wheel_effects_n_m(estimate);
        self.actuation.set_wheel_effects(&effects);
        let asked = tracking.as_ref().map(|output| output.torque_b_n_m);
        let actuated = self.excite(estimate, asked.as_ref(), drive, pulse);
        let report = Report {
            mode: ControlStatus::MODE_EXCITE,
            reason: ControlStatus::REASON_NONE,
            tracking,
            asked_b_n_m: asked.unwrap_or_default(),
            actuated,
        };
        self.finish(now, estimate.stamp, report, outputs);
    }

    pub(super) fn track(
        &mut self,
        now: Timestamp,
        estimate: &Estimate,
        authority: Authority,
        outputs: &mut Outputs,
    ) {
        self.fault = None;
        let (played, pulse) = self.played(estimate, authority);
        if let Played::Drive(drive) = &played
            && drive.hold != Hold::Attitude
        {
            return self.let_go(now, estimate, drive, pulse, outputs);
        }
        let dt_s = self.step_length_s(now);
        // An excitation that reached a limit is stopped at once: the reference is at rest immediately.
        let from_rate = if matches!(played, Played::Refused(_)) { 0.0 } else { 1.0 };
        let body = Reference {
            q_world_reference: estimate.q_world_body,
            omega_wr_r_rad_s: estimate.omega_wb_b_rad_s * from_rate,
            omega_dot_wr_r_rad_s2: Vector3::zeros(),
        };
        let received = self.inputs.reference();
        let goal = match (authority, received) {
            _ if matches!(played, Played::Refused(_)) => Goal::Hold,
            (Authority::Track, Some((stamp, valid_for_s, reference, _))) => {
                Goal::Follow(*stamp, *valid_for_s, reference)
            }
            _ => Goal::Hold,
        };
        let source_stale = received.is_none_or(|(_, _, _, mode)| *mode == AttitudeReference::MODE_HOLD);
        let aim = self.target.step(estimate.stamp, goal, &body);
        let (mode, reason) = match (authority, &played) {
            (_, Played::Refused(reason)) => (ControlStatus::MODE_HOLD, *reason),
            (Authority::Lost(_), _) => (ControlStatus::MODE_HOLD, ControlStatus::REASON_NO_AUTHORITY),
            (Authority::Hold, _) => (ControlStatus::MODE_HOLD, ControlStatus::REASON_NONE),
            _ if aim.stale || source_stale => {
                (ControlStatus::MODE_HOLD, ControlStatus::REASON_REFERENCE_STALE)
            }
            _ => (ControlStatus::MODE_TRACK, ControlStatus::REASON_NONE),
        };

        let wheel_momentum = self.actuation.stored_momentum_b_n_m_s(self.inputs.joints());
        let output = self.law.torque(&TrackingInput {
            q_world_body: &estimate.q_world_body,
            omega_wb_b_rad_s: &estimate.omega_wb_b_rad_s,
            reference: &aim.reference,
            wheel_momentum_b_n_m_s: &wheel_momentum,
            modelled_torque_b_n_m: &(self.modelled_torque(estimate) + self.balancing_torque(estimate)),
            dt_s,
        });
        let effects = self.wheel_effects_n_m(estimate);
        self.actuation.set_wheel_effects(&effects);
        let actuated = match &played {
            Played::Drive(drive) => self.excite(estimate, Some(&output.torque_b_n_m), drive, pulse),
            _ => {
                let (joints, failed) = (self.inputs.joints(), self.inputs.jet_failed());
                self.actuation.apply(estimate.stamp, &output.torque_b_n_m, joints, failed)
            }
        };
        self.law.integrate(dt_s, actuated.alpha > 0.999);

        // After loss of authority: once at rest, actuators off.
        let still_rad_s = self.parameters.safe_mode.coast_rate_rad_s;
        self.released = matches!(authority, Authority::Lost(_))
            && aim.reference.omega_wr_r_rad_s.norm() < 1e-9
            && estimate.omega_wb_b_rad_s.norm() < still_rad_s;

        self.balance(now, estimate, &wheel_momentum, outputs);
        let asked_b_n_m = output.torque_b_n_m;
        let report = Report { mode, reason, tracking: Some(output), asked_b_n_m, actuated };
        self.finish(now, estimate.stamp, report, outputs);
    }
}
