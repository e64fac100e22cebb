//! The answer: the posterior, the verdict, estimates, words.

pub(crate) mod answer;
pub(crate) mod diagnosis;
mod digits;
mod noise;
pub(crate) mod posterior;
mod rows;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Aid, Need, hard_without, untold_without};
use whorl_recording::Recording;

/// Consequences of what a recording does not hold, one sentence each.
pub(crate) fn missing_channels(recording: &Recording, model: &PlatformModel) -> Vec<String> {
    let free = !recording.is_clamped(model);
    let (has_wheels, has_gyros) = (!model.wheels().is_empty(), !model.gyros().is_empty());
    let has_actuators = has_wheels || has_gyros || !model.jets().is_empty();
    let no_force = free && recording.specific_force_b_m_s2.is_empty();
    let no_torque = recording.body_torque_b_n_m.is_empty();
    let vectors = recording.vectors.len();
    let no_jets = free && !model.jets().is_empty() && recording.jet_pulses.is_empty() && no_torque;
    let no_actuator = !has_actuators && no_torque;
    let no_speeds = has_wheels && recording.wheel_speed_rad_s.is_empty();
    let no_commands = has_wheels && recording.wheel_torque_command_n_m.is_empty();
    let no_gimbals = has_gyros && recording.gimbal_angle_rad.is_empty();
    let has_fired = recording.jet_pulses.iter().any(|pulses| !pulses.is_empty());
    let no_pressure = has_fired && recording.tank_pressure_pa.is_empty();
    let untested = untold_without(Need::Temperature, model).join(", ");
    let weak = hard_without(Aid::BusVoltage, model).join(", ");
    let no_voltage = has_actuators && recording.bus_voltage_v.is_empty();
    let all = [
        (no_force && vectors < 2, "accelerometer: tilt is known through the gyro, gravity torques less well"),
        (no_force && vectors >= 2, "accelerometer: tilt is known from the vector sensors"),
        (free && vectors == 0, "vector sensor: heading drifts, torques fixed in the room show weakly"),
        (no_jets, "jet commands: it is assumed that no jet fired, and no thruster effect can be tested"),
        (no_actuator, "body torque, wheels or jets: any torque on the platform appears as a missing torque"),
        (no_speeds, "wheel speeds: they are predicted, and wheel friction and inertia weakly observable"),
        (no_commands, "wheel torque commands: friction, windage and voltage of wheels cannot be tested"),
        (no_gimbals, "gimbal angles: the torque of the control moment gyros appears as a missing torque"),
        (no_pressure, "tank pressure: it is predicted from the gas used"),
        (recording.temperature_k.is_empty(), &format!("temperature: {untested} cannot be tested")),
        (no_voltage, &format!("bus voltage: predicted from the discharge, and {weak} weakly observable")),
    ];
    let missing = all.into_iter().filter(|(is_missing, _)| *is_missing);
    missing.map(|(_, text)| format!("{}: no {text}", recording.name)).collect()
}
