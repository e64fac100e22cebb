//! Consequences of what a recording does not hold, one sentence each.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Aid, Need, hard_without, untold_without};
use whorl_recording::Recording;

use crate::signals::clamped::is_clamped;

/// What a recording does not hold, and what follows.
pub(crate) fn missing_channels(recording: &Recording, model: &PlatformModel) -> Vec<String> {
    let clamped = is_clamped(recording, model);
    let mut missing: Vec<&str> = Vec::new();
    if !clamped {
        if recording.specific_force_b_m_s2.is_empty() {
            missing.push(if recording.vectors.len() < 2 {
                "no accelerometer: tilt is known only through the gyro, so gravity torques, gyro bias and sensor effects are harder to distinguish"
            } else {
                "no accelerometer: tilt is known from the vector sensors"
            });
        }
        if recording.vectors.is_empty() {
            missing.push("no vector sensor: heading drifts with the gyro's bias, so torques fixed in the room and gyro errors about the vertical are weakly observable");
        }
        if has_unrecorded_jets(recording, model) {
            missing.push(
                "no jet commands: it is assumed that no jet fired, and no thruster effect can be tested",
            );
        }
    }
    let has_actuators = !model.wheels().is_empty() || !model.jets().is_empty() || !model.gyros().is_empty();
    if !has_actuators && recording.body_torque_b_n_m.is_empty() {
        missing.push("no body torque, and the model has no wheels or jets: any torque on the platform appears as a missing torque");
    }
    if !model.wheels().is_empty() {
        if recording.wheel_speed_rad_s.is_empty() {
            missing.push("no wheel speeds: they are predicted from the commands, so wheel friction and inertia are weakly observable");
        }
        if recording.wheel_torque_command_n_m.is_empty() {
            missing.push("no wheel torque commands: friction, windage and supply voltage of the wheels cannot be tested");
        }
    }
    if !model.gyros().is_empty() && recording.gimbal_angle_rad.is_empty() {
        missing.push("no gimbal angles: the torque of the control moment gyros appears as a missing torque");
    }
    if recording.tank_pressure_pa.is_empty() && recording.jet_pulses.iter().any(|p| !p.is_empty()) {
        missing.push("no tank pressure: it is predicted from the gas used");
    }
    let no_temperature =
        format!("no temperature: {} cannot be tested", untold_without(Need::Temperature, model).join(", "));
    if recording.temperature_k.is_empty() {
        missing.push(&no_temperature);
    }
    let no_voltage = format!(
        "no bus voltage: it is predicted from the model's discharge, so {} is weakly observable",
        hard_without(Aid::BusVoltage, model).join(", ")
    );
    if has_actuators && recording.bus_voltage_v.is_empty() {
        missing.push(&no_voltage);
    }
    missing.into_iter().map(|text| format!("{}: {text}", recording.name)).collect()
}

/// Whether the platform has jets and nothing says whether they fired.
fn has_unrecorded_jets(recording: &Recording, model: &PlatformModel) -> bool {
    !model.jets().is_empty() && recording.jet_pulses.is_empty() && recording.body_torque_b_n_m.is_empty()
}
