//! Outputs of the core's steps: command, status, diagnostics, log.

use std::time::Duration;

use nalgebra::Vector3;
use whorl_control::tracking::TrackingOutput;
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Route, Topic};
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus};
use whorl_node::{LogLevel, Outputs, Timestamp};

use crate::actuation::{Actuated, Found};
use crate::core::LocalControlCore;
use crate::diagnostics::{Summary, diagnostics, phrase};
use crate::inputs::Estimate;

const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// Result of a step.
pub(crate) struct Report {
    /// `ControlStatus.mode`.
    pub mode: u8,
    /// `ControlStatus.reason`.
    pub reason: u8,
    /// The law's errors, when it was used.
    pub tracking: Option<TrackingOutput>,
    /// Torque asked of the actuators, body axes [N m].
    pub asked_b_n_m: Vector3<f64>,
    /// What the actuators achieved.
    pub actuated: Actuated,
}

impl LocalControlCore {
    /// Publishes command and status of a step and notes what it was.
    pub(crate) fn finish(
        &mut self,
        now: Timestamp,
        stamp: Timestamp,
        mut report: Report,
        outputs: &mut Outputs,
    ) {
        // Commands are sent all the same: the driver obeys the first one that it can take. In safe mode the reason for that
        // says more: without measurements commands are rare, and the gate closes between them.
        let points = matches!(
            report.mode,
            ControlStatus::MODE_TRACK | ControlStatus::MODE_HOLD | ControlStatus::MODE_EXCITE
        );
        if points && self.inputs.disobeyed(now) {
            report.mode = ControlStatus::MODE_SAFE_COAST;
            report.reason = ControlStatus::REASON_COMMANDS_REFUSED;
        }
        let stamp = self.latest_stamp.map_or(stamp, |latest| latest.max(stamp));
        if (self.mode, self.reason) != (report.mode, report.reason) {
            let safe =
                matches!(report.mode, ControlStatus::MODE_SAFE_DAMPING | ControlStatus::MODE_SAFE_COAST)
                    || report.reason >= ControlStatus::REASON_EXCITATION_LIMIT;
            outputs.log(
                if safe { LogLevel::Warn } else { LogLevel::Info },
                format!("{}: {}", self.parameters.name, phrase(report.mode, report.reason)),
            );
            self.mode = report.mode;
            self.reason = report.reason;
        }
        self.latest_stamp = Some(stamp);
        self.latest_step = Some(now);
        self.publish_command(now, stamp, outputs);
        if self.next_status.is_none_or(|due| due <= now) {
            // On the grid of the status rate, whatever the grid of the steps.
            let period = Duration::from_secs_f64(1.0 / self.parameters.status_rate_hz);
            let next = self.next_status.map_or(now + period, |due| due + period);
            self.next_status = Some(if next <= now { now + period } else { next });
            self.publish_status(now, stamp, &report, outputs);
        }
    }

    /// Passes an estimate to the mass balancing and sends its decision.
    pub(crate) fn balance(
        &mut self,
        now: Timestamp,
        estimate: &Estimate,
        wheel_momentum_b_n_m_s: &Vector3<f64>,
        outputs: &mut Outputs,
    ) {
        let Some(balancing) = &mut self.balancing else { return };
        let output = balancing.step(now, estimate, wheel_momentum_b_n_m_s);
        if let Some(moment) = output.moment_b_n_m {
            outputs.publish(
                Route::platform(self.parameters.platform, Topic::BallastMoment),
                Vector3Stamped {
                    header: Header { stamp: estimate.stamp.into(), frame_id: self.frame_id.clone() },
                    vector: moment.into(),
                },
            );
        }
        if let Some(sentence) = output.sentence {
            outputs.log(LogLevel::Info, format!("{}: {sentence}", self.parameters.name));
        }
    }

    fn publish_command(&mut self, now: Timestamp, stamp: Timestamp, outputs: &mut Outputs) {
        let validity = Duration::from_secs_f64(self.parameters.command_validity_s + self.stall_s);
        let mut command = ActuatorCommand {
            header: Header { stamp: stamp.into(), frame_id: self.frame_id.clone() },
            sequence: self.command_sequence,
            valid_until: (now + validity).into(),
            jet_slot: self.actuation.slot(),
            jet_slot_length_s: self.actuation.slot_length_s(),
            jet_on_time_s: self.actuation.on_time_s().to_vec(),
            ..ActuatorCommand::default()
        };
        for (k, kind) in self.gyrostat.model().actuators.kinds().into_iter().enumerate() {
            let field = kind.channel().and_then(|channel| command.motor_commands_mut(channel.command_field));
            if let Some(field) = field {
                field.extend_from_slice(self.actuation.commands(k));
            }
        }
        outputs.publish(Route::platform(self.parameters.platform, Topic::ActuatorCommand), command);
        self.command_sequence += 1;
    }

    fn publish_status(&mut self, now: Timestamp, stamp: Timestamp, report: &Report, outputs: &mut Outputs) {
        let unknown = Vector3::repeat(f64::NAN);
        let estimate = self.inputs.estimate();
        let age_s = |stamp: Option<Timestamp>| stamp.map_or(f64::NAN, |stamp| now.seconds_since(stamp));
        let status = ControlStatus {
            header: Header { stamp: stamp.into(), frame_id: self.frame_id.clone() },
            sequence: self.status_sequence,
            mode: report.mode,
            reason: report.reason,
            attitude_error_b_rad: report.tracking.map_or(unknown, |t| t.attitude_error_b_rad).into(),
            rate_error_b_rad_s: report.tracking.map_or(unknown, |t| t.rate_error_b_rad_s).into(),
            torque_commanded_b_n_m: report.asked_b_n_m.into(),
            torque_achieved_b_n_m: report.actuated.achieved_b_n_m.into(),
            alpha: report.actuated.alpha,
            allocation: match report.actuated.found {
                Found::Solved => ControlStatus::ALLOCATION_SOLVED,
                Found::Unique => ControlStatus::ALLOCATION_UNIQUE,
                Found::Fallback => ControlStatus::ALLOCATION_FALLBACK,
                Found::Off => ControlStatus::ALLOCATION_OFF,
            },
            jet_saturated: self.actuation.saturated_jets(),
            jet_failed: self.actuation.failed_jets(),
            wheel_momentum_b_n_m_s: self.actuation.stored_momentum_b_n_m_s(self.inputs.joints()).into(),
            gas_used_kg: self.actuation.gas_used_kg(),
            tilt_rad: estimate
                .filter(|e| e.usable)
                .map_or(f64::NAN, |e| self.safe_envelope.angle_rad(&e.q_world_body)),
            estimate_age_s: age_s(estimate.map(|e| e.stamp)),
            reference_age_s: age_s(self.inputs.reference().map(|(stamp, ..)| *stamp)),
            allocation_fallbacks: self.actuation.fallbacks(),
        };
        outputs.publish(Route::platform(self.parameters.platform, Topic::ControlStatus), status);
        self.status_sequence += 1;
    }

    /// The node's line in `/diagnostics`, once a second.
    pub(crate) fn publish_diagnostics(&mut self, now: Timestamp, outputs: &mut Outputs) {
        if self.next_diagnostics.is_none_or(|due| due <= now) {
            self.next_diagnostics = Some(now + DIAGNOSTICS_PERIOD);
            let summary = Summary {
                mode: self.mode,
                reason: self.reason,
                refused: self.inputs.refused(),
                fallbacks: self.actuation.fallbacks(),
                checks: self.actuation.checks(),
                failed_jets: self.actuation.failed_jets().iter().filter(|failed| **failed).count(),
                unloading: self.actuation.unloading(),
                gas_used_kg: self.actuation.gas_used_kg(),
                singularity_measure: self.actuation.singularity_measure(),
            };
            outputs.publish(
                Route::shared(Topic::Diagnostics),
                diagnostics(now, &self.parameters.name, &summary),
            );
        }
    }
}
