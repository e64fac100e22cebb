//! The node's line in `/diagnostics`.

use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::ControlStatus;
use whorl_node::Timestamp;

use crate::actuation::AllocationChecks;
use crate::inputs::Refused;

/// Name of a `ControlStatus.mode`.
pub fn mode_name(mode: u8) -> &'static str {
    match mode {
        ControlStatus::MODE_IDLE => "idle",
        ControlStatus::MODE_TRACK => "tracking",
        ControlStatus::MODE_HOLD => "holding",
        ControlStatus::MODE_SAFE_DAMPING => "safe: damping",
        ControlStatus::MODE_SAFE_COAST => "safe: coasting",
        ControlStatus::MODE_EXCITE => "excited",
        _ => "unknown",
    }
}

/// A `ControlStatus.reason` in words.
pub fn reason_text(reason: u8) -> &'static str {
    match reason {
        ControlStatus::REASON_NONE => "",
        ControlStatus::REASON_NO_AUTHORITY => "nobody has authority",
        ControlStatus::REASON_REFERENCE_STALE => "the reference is not renewed",
        ControlStatus::REASON_ESTIMATE_STALE => "no attitude estimate",
        ControlStatus::REASON_ESTIMATE_UNHEALTHY => "the attitude estimate is not usable",
        ControlStatus::REASON_TILT_LIMIT => "tilt near its stop",
        ControlStatus::REASON_ABORT => "aborted",
        ControlStatus::REASON_RATE_LIMIT => "body rate beyond its limit",
        ControlStatus::REASON_EXCITATION_LIMIT => {
            "the excitation came to a limit of tilt, rate or wheel speed"
        }
        ControlStatus::REASON_EXCITATION_UNKNOWN => "there is no excitation of this name",
        ControlStatus::REASON_COMMANDS_REFUSED => "the driver does not carry out the commands",
        _ => "unknown reason",
    }
}

/// Mode and reason in one phrase.
pub fn phrase(mode: u8, reason: u8) -> String {
    match reason_text(reason) {
        "" => mode_name(mode).to_owned(),
        reason => format!("{}: {reason}", mode_name(mode)),
    }
}

/// Content of the diagnostics.
pub struct Summary {
    /// `ControlStatus.mode`.
    pub mode: u8,
    /// `ControlStatus.reason`.
    pub reason: u8,
    /// Messages that were not used.
    pub refused: Refused,
    /// Allocations that needed the fallback.
    pub fallbacks: u64,
    /// Allocations compared with the exact oracle.
    pub checks: AllocationChecks,
    /// Jets held at zero.
    pub failed_jets: usize,
    /// Whether jets are unloading the wheels.
    pub unloading: bool,
    /// Gas used by the model [kg].
    pub gas_used_kg: f64,
    /// How far gimbals are from a singular configuration, if the platform has any.
    pub singularity_measure: Option<f64>,
}

/// The message.
pub fn diagnostics(now: Timestamp, name: &str, s: &Summary) -> DiagnosticArray {
    let level = match s.mode {
        ControlStatus::MODE_SAFE_DAMPING | ControlStatus::MODE_SAFE_COAST => DiagnosticStatus::ERROR,
        ControlStatus::MODE_HOLD if s.reason != ControlStatus::REASON_NONE => DiagnosticStatus::WARN,
        _ if s.failed_jets > 0 || s.checks.disagreed > 0 => DiagnosticStatus::WARN,
        _ => DiagnosticStatus::OK,
    };
    let value = |key: &str, value: String| KeyValue { key: key.to_owned(), value };
    let gimbals =
        s.singularity_measure.map(|m| value("singularity measure of the gimbals", format!("{m:.4}")));
    DiagnosticArray {
        header: Header { stamp: now.into(), frame_id: String::new() },
        status: vec![DiagnosticStatus {
            level,
            name: format!("{name}: local_control"),
            message: phrase(s.mode, s.reason),
            hardware_id: name.to_owned(),
            values: [
                value("messages not finite", s.refused.not_finite.to_string()),
                value("messages out of order", s.refused.out_of_order.to_string()),
                value("messages late", s.refused.late.to_string()),
                value("messages of wrong size", s.refused.wrong_size.to_string()),
                value("allocation fallbacks", s.fallbacks.to_string()),
                value("allocations compared with the oracle", s.checks.compared.to_string()),
                value("allocations that disagree with it", s.checks.disagreed.to_string()),
                value("failed jets", s.failed_jets.to_string()),
                value("unloading wheels", s.unloading.to_string()),
                value("gas used [kg]", format!("{:.5}", s.gas_used_kg)),
            ]
            .into_iter()
            .chain(gimbals)
            .collect(),
        }],
    }
}
