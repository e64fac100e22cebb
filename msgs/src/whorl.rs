//! `whorl_msgs`: Whorl's own messages. Units, frames and invalid values: `msg/*.msg`.
#![allow(missing_docs)]

use serde::{Deserialize, Serialize};
use serde_big_array::BigArray;

use crate::builtin_interfaces::Time;
use crate::geometry_msgs::{Quaternion, Vector3};
use crate::std_msgs::Header;

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ActuatorCommand {
    pub header: Header,
    pub sequence: u64,
    pub valid_until: Time,
    pub wheel_torque_n_m: Vec<f64>,
    pub jet_slot: u64,
    pub jet_slot_length_s: f64,
    pub jet_on_time_s: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ThrusterState {
    pub header: Header,
    pub sequence: u64,
    pub valve_open: Vec<bool>,
    pub on_time_s: Vec<f64>,
    pub total_on_time_s: Vec<f64>,
    pub health: Vec<u8>,
}

impl ThrusterState {
    pub const HEALTH_OK: u8 = 0;
    pub const HEALTH_FAILED: u8 = 1;
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AttitudeEstimate {
    pub header: Header,
    pub sequence: u64,
    pub q_world_body: Quaternion,
    pub omega_wb_b_rad_s: Vector3,
    pub gyro_bias_b_rad_s: Vector3,
    #[serde(with = "BigArray")]
    pub covariance: [f64; 36],
    pub nis: f64,
    pub nis_dof: u8,
    pub health: u8,
    pub flags: u32,
    pub rejected_samples: u32,
}

impl Default for AttitudeEstimate {
    fn default() -> Self {
        Self {
            header: Header::default(),
            sequence: 0,
            q_world_body: Quaternion::default(),
            omega_wb_b_rad_s: Vector3::default(),
            gyro_bias_b_rad_s: Vector3::default(),
            covariance: [0.0; 36],
            nis: 0.0,
            nis_dof: 0,
            health: 0,
            flags: 0,
            rejected_samples: 0,
        }
    }
}

impl AttitudeEstimate {
    pub const HEALTH_INITIALISING: u8 = 0;
    pub const HEALTH_OK: u8 = 1;
    pub const HEALTH_DEGRADED: u8 = 2;
    pub const HEALTH_UNHEALTHY: u8 = 3;
    pub const FLAG_GYRO_REJECTED: u32 = 1;
    pub const FLAG_ACCELEROMETER_REJECTED: u32 = 2;
    pub const FLAG_VECTOR_REJECTED: u32 = 4;
    pub const FLAG_VECTOR_STALE: u32 = 8;
    pub const FLAG_IMU_STALE: u32 = 16;
    pub const FLAG_INCONSISTENT: u32 = 32;

    /// Whether attitude and rate may be used for control.
    #[must_use]
    pub fn usable(&self) -> bool {
        matches!(self.health, Self::HEALTH_OK | Self::HEALTH_DEGRADED)
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ParameterEstimate {
    pub header: Header,
    pub sequence: u64,
    pub name: Vec<String>,
    pub value: Vec<f64>,
    pub stddev: Vec<f64>,
    pub prior_stddev: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct AttitudeReference {
    pub header: Header,
    pub sequence: u64,
    pub valid_until: Time,
    pub q_world_reference: Quaternion,
    pub omega_wr_r_rad_s: Vector3,
    pub omega_dot_wr_r_rad_s2: Vector3,
    pub mode: u8,
}

impl AttitudeReference {
    pub const MODE_TRACK: u8 = 0;
    pub const MODE_HOLD: u8 = 1;
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ControlStatus {
    pub header: Header,
    pub sequence: u64,
    pub mode: u8,
    pub reason: u8,
    pub attitude_error_b_rad: Vector3,
    pub rate_error_b_rad_s: Vector3,
    pub torque_commanded_b_n_m: Vector3,
    pub torque_achieved_b_n_m: Vector3,
    pub alpha: f64,
    pub allocation: u8,
    pub jet_saturated: Vec<bool>,
    pub jet_failed: Vec<bool>,
    pub wheel_momentum_b_n_m_s: Vector3,
    pub gas_used_kg: f64,
    pub tilt_rad: f64,
    pub estimate_age_s: f64,
    pub reference_age_s: f64,
    pub allocation_fallbacks: u64,
}

impl ControlStatus {
    pub const MODE_IDLE: u8 = 0;
    pub const MODE_TRACK: u8 = 1;
    pub const MODE_HOLD: u8 = 2;
    pub const MODE_SAFE_DAMPING: u8 = 3;
    pub const MODE_SAFE_COAST: u8 = 4;
    pub const MODE_EXCITE: u8 = 5;
    pub const REASON_NONE: u8 = 0;
    pub const REASON_NO_AUTHORITY: u8 = 1;
    pub const REASON_REFERENCE_STALE: u8 = 2;
    pub const REASON_ESTIMATE_STALE: u8 = 3;
    pub const REASON_ESTIMATE_UNHEALTHY: u8 = 4;
    pub const REASON_TILT_LIMIT: u8 = 5;
    pub const REASON_ABORT: u8 = 6;
    pub const REASON_RATE_LIMIT: u8 = 7;
    pub const REASON_EXCITATION_LIMIT: u8 = 8;
    pub const REASON_EXCITATION_UNKNOWN: u8 = 9;
    pub const ALLOCATION_SOLVED: u8 = 0;
    pub const ALLOCATION_UNIQUE: u8 = 1;
    pub const ALLOCATION_FALLBACK: u8 = 2;
    pub const ALLOCATION_OFF: u8 = 3;
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Excitation {
    pub header: Header,
    pub sequence: u64,
    pub name: String,
    pub elapsed_s: f64,
    pub valid_until: Time,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ClockRequest {
    pub header: Header,
    pub sequence: u64,
    pub platforms: Vec<String>,
    pub offset_s: Vec<f64>,
    pub uncertainty_s: Vec<f64>,
    pub applied_s: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ClockReply {
    pub header: Header,
    pub sequence: u64,
    pub asked: Time,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FormationCommand {
    pub header: Header,
    pub sequence: u64,
    pub command: u8,
    pub valid_until: Time,
}

impl FormationCommand {
    pub const COMMAND_STANDBY: u8 = 0;
    pub const COMMAND_TRACK: u8 = 1;
    pub const COMMAND_HOLD: u8 = 2;
    pub const COMMAND_ABORT: u8 = 3;
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FormationState {
    pub header: Header,
    pub sequence: u64,
    pub experiment: String,
    pub law: String,
    pub phase: u8,
    pub step: String,
    pub step_elapsed_s: f64,
    pub run_elapsed_s: f64,
    pub run_length_s: f64,
    pub platforms: Vec<String>,
    pub leader: Vec<i32>,
    pub q_leader_platform: Vec<Quaternion>,
    pub relative_error_rad: Vec<Vector3>,
    pub link_age_s: Vec<f64>,
    pub link_ok: Vec<bool>,
    pub estimate_health: Vec<u8>,
    pub control_mode: Vec<u8>,
    pub reference_clipped: Vec<bool>,
}

impl FormationState {
    pub const PHASE_WAITING: u8 = 0;
    pub const PHASE_READY: u8 = 1;
    pub const PHASE_SETTLE: u8 = 2;
    pub const PHASE_MANOEUVRE: u8 = 3;
    pub const PHASE_HOLD: u8 = 4;
    pub const PHASE_FINISHED: u8 = 5;
    pub const PHASE_ABORTED: u8 = 6;
}

/// Request and response of the services in `srv/`: all take one string and answer alike.
pub mod srv {
    use serde::{Deserialize, Serialize};

    #[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
    pub struct StartExperimentRequest {
        pub experiment: String,
    }

    #[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
    pub struct AbortExperimentRequest {
        pub reason: String,
    }

    /// Response of both services.
    #[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
    pub struct ExperimentResponse {
        pub success: bool,
        pub message: String,
    }
}
