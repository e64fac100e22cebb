//! Decides whether the platform may point, and runs the safe modes otherwise.

use nalgebra::Vector3;
use whorl_control::safe_mode::SafeState;
use whorl_msgs::whorl::ControlStatus;
use whorl_node::{Outputs, Timestamp};

use super::LocalControlCore;
use crate::authority::Authority;
use crate::inputs::Estimate;
use crate::publishing::Report;

/// Share of a limit below which a tilt or rate fault ends.
const FAULT_RELEASE: f64 = 0.95;

impl LocalControlCore {
    /// Whether actuators may be used now, and how.
    pub(super) fn authority(&self, now: Timestamp) -> Authority {
        match self.heartbeat.authority(now) {
            Authority::Lost(for_s) if self.released || for_s > self.parameters.limits.authority_grace_s => {
                Authority::None
            }
            authority => authority,
        }
    }

    pub(super) fn fresh_estimate(&self, now: Timestamp) -> Option<&Estimate> {
        let timeout_s = self.parameters.limits.estimate_timeout_s + self.stall_s;
        let fresh = |e: &&Estimate| now.seconds_since(e.stamp) <= timeout_s;
        self.inputs.estimate().filter(fresh)
    }

    /// Why the platform may not point now.
    pub(super) fn find_fault(&self, now: Timestamp, authority: Authority) -> Option<u8> {
        if authority == Authority::Abort {
            return Some(ControlStatus::REASON_ABORT);
        }
        let Some(estimate) = self.fresh_estimate(now) else {
            return Some(ControlStatus::REASON_ESTIMATE_STALE);
        };
        if !estimate.usable {
            return Some(ControlStatus::REASON_ESTIMATE_UNHEALTHY);
        }
        // Hysteresis: a fault of this kind ends only clearly inside its limit.
        let limit = |reason: u8, limit: f64| {
            if self.fault == Some(reason) { limit * FAULT_RELEASE } else { limit }
        };
        let tilt = self.safe_envelope.angle_rad(&estimate.q_world_body);
        if tilt > limit(ControlStatus::REASON_TILT_LIMIT, self.safe_envelope.max_rad()) {
            return Some(ControlStatus::REASON_TILT_LIMIT);
        }
        let max_rate = self.parameters.limits.max_rate_rad_s;
        if estimate.omega_wb_b_rad_s.norm() > limit(ControlStatus::REASON_RATE_LIMIT, max_rate) {
            return Some(ControlStatus::REASON_RATE_LIMIT);
        }
        None
    }

    pub(super) fn idle(&mut self, now: Timestamp, stamp: Timestamp, outputs: &mut Outputs) {
        self.leave_tracking();
        self.safe_mode.reset();
        self.fault = None;
        let actuated = self.actuation.off();
        let report = Report {
            mode: ControlStatus::MODE_IDLE,
            reason: ControlStatus::REASON_NO_AUTHORITY,
            tracking: None,
            asked_b_n_m: Vector3::zeros(),
            actuated,
        };
        self.finish(now, stamp, report, outputs);
    }

    pub(super) fn safe(
        &mut self,
        now: Timestamp,
        stamp: Timestamp,
        authority: Authority,
        outputs: &mut Outputs,
    ) {
        let dt_s = self.step_length_s(now);
        let fault = self.find_fault(now, authority);
        let tracked = self.safe_mode.state() == SafeState::Nominal;
        let gyro = self.inputs.gyro_rate(now, self.parameters.limits.imu_timeout_s + self.stall_s);
        let state = self.safe_mode.step(dt_s, fault.is_some(), gyro.as_ref());
        if state == SafeState::Nominal {
            // Recovered, or only a short gap: tracking resumes with the next estimate.
            return;
        }
        if tracked {
            self.leave_tracking();
        }
        // The reason is kept until tracking resumes, also while waiting for recovery.
        let reason = fault.or(self.fault).unwrap_or(ControlStatus::REASON_NONE);
        self.fault = Some(reason);
        let (mode, asked_b_n_m, actuated) = match (state, gyro) {
            (SafeState::Damping, Some(omega)) => {
                let inertia = self.law.equation().resisting_b_kg_m2();
                let torque = self.safe_mode.damping_torque_b_n_m(inertia, &omega);
                let actuated =
                    self.actuation.apply(stamp, &torque, self.inputs.joints(), self.inputs.jet_failed());
                (ControlStatus::MODE_SAFE_DAMPING, torque, actuated)
            }
            _ => (ControlStatus::MODE_SAFE_COAST, Vector3::zeros(), self.actuation.off()),
        };
        let report = Report { mode, reason, tracking: None, asked_b_n_m, actuated };
        self.finish(now, stamp, report, outputs);
    }
}
