//! Consequences of what a recording does not hold, one sentence each.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Aid, Need, hard_without, untold_without};
use whorl_recording::Recording;

use crate::signals::is_clamped;

/// What a recording does not hold, and what follows.
pub(crate) fn missing_channels(recording: &Recording, model: &PlatformModel) -> Vec<String> {
    let free = !is_clamped(recording, model);
    let (has_wheels, has_gyros) = (!model.wheels().is_empty(), !model.gyros().is_empty());
    let has_actuators = has_wheels || has_gyros || !model.jets().is_empty();
    let no_force = free && recording.specific_force_b_m_s2.is_empty();
    let no_torque = recording.body_torque_b_n_m.is_empty();
    let vectors = recording.vectors.len();
    let untested = untold_without(Need::Temperature, model).join(", ");
    let weak = hard_without(Aid::BusVoltage, model).join(", ");
    let no_temperature = format!("no temperature: {untested} cannot be tested");
    let no_voltage =
        format!("no bus voltage: it is predicted from the model's discharge, so {weak} is weakly observable");
    let all = [
        (
            no_force && vectors < 2,
            "no accelerometer: tilt is known only through the gyro, so gravity torques, gyro bias and sensor effects are harder to distinguish",
        ),
        (no_force && vectors >= 2, "no accelerometer: tilt is known from the vector sensors"),
        (
            free && vectors == 0,
            "no vector sensor: heading drifts with the gyro's bias, so torques fixed in the room and gyro errors about the vertical are weakly observable",
        ),
        (
            free && !model.jets().is_empty() && recording.jet_pulses.is_empty() && no_torque,
            "no jet commands: it is assumed that no jet fired, and no thruster effect can be tested",
        ),
        (
            !has_actuators && no_torque,
            "no body torque, and the model has no wheels or jets: any torque on the platform appears as a missing torque",
        ),
        (
            has_wheels && recording.wheel_speed_rad_s.is_empty(),
            "no wheel speeds: they are predicted from the commands, so wheel friction and inertia are weakly observable",
        ),
        (
            has_wheels && recording.wheel_torque_command_n_m.is_empty(),
            "no wheel torque commands: friction, windage and supply voltage of the wheels cannot be tested",
        ),
        (
            has_gyros && recording.gimbal_angle_rad.is_empty(),
            "no gimbal angles: the torque of the control moment gyros appears as a missing torque",
        ),
        (
            recording.tank_pressure_pa.is_empty() && recording.jet_pulses.iter().any(|p| !p.is_empty()),
            "no tank pressure: it is predicted from the gas used",
        ),
        (recording.temperature_k.is_empty(), &no_temperature),
        (has_actuators && recording.bus_voltage_v.is_empty(), &no_voltage),
    ];
    let missing = all.into_iter().filter(|(is_missing, _)| *is_missing);
    missing.map(|(_, text)| format!("{}: {text}", recording.name)).collect()
}
