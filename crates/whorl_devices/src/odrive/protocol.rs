//! CANSimple, the protocol of ODrive motor controllers on a CAN bus, as pure functions.
//!
//! Source: ODrive documentation, "CAN Protocol" (docs.odriverobotics.com, v/latest, manual/can-protocol): "Overview" for
//! identifiers, byte order and requests, the table of messages for numbers and fields, "Set_Axis_State", "Heartbeat",
//! "Set_Controller_Mode", "Set_Input_Vel", "Set_Input_Torque", "Get_Encoder_Estimates", "Clear_Errors"; errors as its CAN database
//! (firmware 0.6.10) names them. Not checked against a controller.

use std::f64::consts::TAU;

use crate::bus::Frame;

/// Largest number of a node; 63 is that of one without a number.
pub const LARGEST_NODE: u8 = 62;

/// Messages that are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Message {
    /// From the controller, by itself: errors and state.
    Heartbeat = 0x01,
    /// To it: which state it shall have.
    SetAxisState = 0x07,
    /// From it, when asked: turns, and turns a second.
    GetEncoderEstimates = 0x09,
    /// To it: what it controls.
    SetControllerMode = 0x0B,
    /// To it: turns a second, and N m besides.
    SetInputVel = 0x0D,
    /// To it: N m.
    SetInputTorque = 0x0E,
    /// To it: errors are forgotten.
    ClearErrors = 0x18,
}

impl Message {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Heartbeat,
        Self::SetAxisState,
        Self::GetEncoderEstimates,
        Self::SetControllerMode,
        Self::SetInputVel,
        Self::SetInputTorque,
        Self::ClearErrors,
    ];
}

/// Motor without current.
pub const IDLE: u32 = 1;
/// Motor controlled.
pub const CLOSED_LOOP: u32 = 8;
/// Control modes.
pub const TORQUE_CONTROL: u32 = 1;
/// As [`TORQUE_CONTROL`].
pub const VELOCITY_CONTROL: u32 = 2;
/// Input mode: as it comes.
pub const PASSTHROUGH: u32 = 1;

/// The identifier of a node's message: the node in the upper six bits.
#[must_use]
pub fn identifier(message: Message, node: u8) -> u16 {
    u16::from(node & 0x3F) << 5 | message as u16
}

/// Asks for a state.
#[must_use]
pub fn set_axis_state(node: u8, state: u32) -> Frame {
    Frame::new(identifier(Message::SetAxisState, node), &state.to_le_bytes())
}

/// Says what is controlled.
#[must_use]
pub fn set_controller_mode(node: u8, control: u32, input: u32) -> Frame {
    let data: Vec<u8> = [control.to_le_bytes(), input.to_le_bytes()].concat();
    Frame::new(identifier(Message::SetControllerMode, node), &data)
}

/// Commands a torque.
#[must_use]
pub fn set_input_torque(node: u8, torque_n_m: f64) -> Frame {
    Frame::new(identifier(Message::SetInputTorque, node), &(torque_n_m as f32).to_le_bytes())
}

/// Commands a speed, with a torque besides what the loop asks for.
#[must_use]
pub fn set_input_vel(node: u8, speed_rad_s: f64, torque_n_m: f64) -> Frame {
    let data = [((speed_rad_s / TAU) as f32).to_le_bytes(), (torque_n_m as f32).to_le_bytes()].concat();
    Frame::new(identifier(Message::SetInputVel, node), &data)
}

/// Asks how the motor turns.
#[must_use]
pub fn ask_encoder_estimates(node: u8) -> Frame {
    Frame::remote(identifier(Message::GetEncoderEstimates, node), 8)
}

/// Has errors forgotten.
#[must_use]
pub fn clear_errors(node: u8) -> Frame {
    // The byte: whether a lamp shall blink.
    Frame::new(identifier(Message::ClearErrors, node), &[0])
}

/// How the motor turns: angle \[rad\] and speed [rad/s].
#[must_use]
pub fn encoder_estimates(frame: &Frame) -> Option<(f64, f64)> {
    let turns = f64::from(f32::from_le_bytes(frame.bytes(0)?));
    let turns_s = f64::from(f32::from_le_bytes(frame.bytes(4)?));
    Some((turns * TAU, turns_s * TAU)).filter(|(angle, speed)| angle.is_finite() && speed.is_finite())
}

/// What a heartbeat says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heartbeat {
    /// What is wrong, a bit each.
    pub error: u32,
    /// As [`IDLE`].
    pub state: u8,
    /// How its last procedure has ended; 0: well, 1: not yet.
    pub result: u8,
}

/// A heartbeat.
#[must_use]
pub fn heartbeat(frame: &Frame) -> Option<Heartbeat> {
    let [state, result] = frame.bytes(4)?;
    Some(Heartbeat { error: u32::from_le_bytes(frame.bytes(0)?), state, result })
}

/// Errors in words.
#[must_use]
pub fn error_words(error: u32) -> String {
    const BITS: [(u32, &str); 22] = [
        (1, "it initialises"),
        (2, "system level"),
        (4, "timing"),
        (8, "no estimate of the encoder"),
        (16, "wrong configuration"),
        (32, "gate driver"),
        (64, "no input"),
        (256, "bus overvoltage"),
        (512, "bus undervoltage"),
        (1024, "bus overcurrent"),
        (2048, "too much current back to the supply"),
        (4096, "current limit"),
        (8192, "motor too hot"),
        (16_384, "inverter too hot"),
        (32_768, "velocity limit"),
        (65_536, "position limit"),
        (1 << 24, "its watchdog has not heard the driver"),
        (1 << 25, "emergency stop"),
        (1 << 26, "the motor spins out"),
        (1 << 27, "brake resistor disarmed"),
        (1 << 28, "thermistor disconnected"),
        (1 << 30, "calibration"),
    ];
    let words: Vec<&str> = BITS.iter().filter(|(bit, _)| error & bit != 0).map(|(_, words)| *words).collect();
    if words.is_empty() { format!("error 0x{error:08X}") } else { words.join(", ") }
}
