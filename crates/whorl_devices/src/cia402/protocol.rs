//! What goes over a CANopen bus to motor controllers of profile CiA 402, as pure functions.
//!
//! Sources: CiA 301 (services and identifiers) and maxon's "EPOS4 Firmware Specification", edition 2026-07: states and commands
//! (tables 2-5 to 2-7, pages 2-15 and 2-16), controlword (6.2.94) and statusword (6.2.95), modes of operation (6.2.101), abort
//! connection option (6.2.92), rated torque (6.2.112), errors (7.2), abort codes (7.3); "EPOS4 Communication Guide", NMT, SDO,
//! PDO (3.3.3). Both were read as others quote them. Not checked against a controller.

use crate::bus::Frame;

/// NMT commands have this identifier.
pub const NMT: u16 = 0x000;
/// What all controllers act on at once.
pub const SYNC: u16 = 0x080;
/// The node number under which the driver says that it lives.
pub const DRIVER: u8 = 127;

/// Identifiers of a node's messages (CiA 301, the predefined connection set).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Service {
    /// Something went wrong, or is right again.
    Emergency = 0x080,
    /// First process data from the node.
    TransmitPdo = 0x180,
    /// First process data to the node.
    ReceivePdo = 0x200,
    /// Answers about its objects.
    SdoAnswer = 0x580,
    /// Questions about its objects.
    SdoQuestion = 0x600,
    /// That it lives, and in what state.
    Heartbeat = 0x700,
}

/// The identifier of a node's messages.
#[must_use]
pub fn identifier(service: Service, node: u8) -> u16 {
    service as u16 + u16::from(node & 0x7F)
}

/// Commands to a node's communication, and the states that they lead to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nmt {
    /// Process data flow.
    Start = 0x01,
    /// Objects alone can be read and written.
    PreOperational = 0x80,
}

/// State of a node's communication, in its heartbeats.
pub const OPERATIONAL: u8 = 0x05;
/// As [`OPERATIONAL`].
pub const PRE_OPERATIONAL: u8 = 0x7F;
/// A node that has just been switched on says so once.
pub const BOOT_UP: u8 = 0x00;

/// A command to a node's communication.
#[must_use]
pub fn nmt(command: Nmt, node: u8) -> Frame {
    Frame::new(NMT, &[command as u8, node])
}

/// That a node lives.
#[must_use]
pub fn heartbeat(node: u8, state: u8) -> Frame {
    Frame::new(identifier(Service::Heartbeat, node), &[state])
}

/// An object of a node: index and subindex.
pub type Object = (u16, u8);

/// Objects that are used.
pub mod objects {
    use super::Object;

    /// Whose heartbeats a node watches, and for how long it waits \[ms\].
    pub const CONSUMER_HEARTBEAT: Object = (0x1016, 1);
    /// Between its own \[ms\].
    pub const PRODUCER_HEARTBEAT: Object = (0x1017, 0);
    /// Identifier of the first process data to the node; bit 31: not used.
    pub const RECEIVE_IDENTIFIER: Object = (0x1400, 1);
    /// When they act; 1: with every SYNC.
    pub const RECEIVE_TYPE: Object = (0x1400, 2);
    /// What they are: subindex 0 how many, from 1 on which.
    pub const RECEIVE_MAPPING: u16 = 0x1600;
    /// As [`RECEIVE_IDENTIFIER`], from the node.
    pub const TRANSMIT_IDENTIFIER: Object = (0x1800, 1);
    /// As [`RECEIVE_TYPE`], from the node.
    pub const TRANSMIT_TYPE: Object = (0x1800, 2);
    /// As [`RECEIVE_MAPPING`], from the node.
    pub const TRANSMIT_MAPPING: u16 = 0x1A00;
    /// What a node does that has lost its bus or the driver.
    pub const ABORT_CONNECTION: Object = (0x6007, 0);
    /// Commands of the state machine.
    pub const CONTROLWORD: Object = (0x6040, 0);
    /// Its state.
    pub const STATUSWORD: Object = (0x6041, 0);
    /// What the controller controls.
    pub const MODE: Object = (0x6060, 0);
    /// What it does control.
    pub const MODE_NOW: Object = (0x6061, 0);
    /// Speed, in the unit of [`VELOCITY_UNIT`].
    pub const VELOCITY: Object = (0x606C, 0);
    /// Torque that is wanted, in thousandths of [`RATED_TORQUE`].
    pub const TARGET_TORQUE: Object = (0x6071, 0);
    /// Torque of the motor at its nominal current.
    pub const RATED_TORQUE: Object = (0x6076, 0);
    /// Torque that it makes, in thousandths of [`RATED_TORQUE`].
    pub const TORQUE: Object = (0x6077, 0);
    /// How quickly the profile's speed rises, and falls [rpm/s].
    pub const PROFILE_ACCELERATION: Object = (0x6083, 0);
    /// As [`PROFILE_ACCELERATION`].
    pub const PROFILE_DECELERATION: Object = (0x6084, 0);
    /// Unit of speeds.
    pub const VELOCITY_UNIT: Object = (0x60A9, 0);
    /// Speed that is wanted.
    pub const TARGET_VELOCITY: Object = (0x60FF, 0);
}

/// A node without the driver has its motor off ([`objects::ABORT_CONNECTION`]).
pub const DISABLE_VOLTAGE: u32 = 2;
/// Speeds in thousandths of a turn a minute ([`objects::VELOCITY_UNIT`]).
pub const MILLI_RPM: u32 = 0xFDB4_4700;
/// Mode that follows a profile of speed.
pub const PROFILE_VELOCITY: u32 = 3;
/// Mode that makes a torque.
pub const CYCLIC_TORQUE: u32 = 10;
/// Identifier of process data that are not used.
pub const PDO_OFF: u32 = 0x8000_0000;

/// How an object of so many bits is named in a mapping.
#[must_use]
pub fn mapped((index, sub): Object, bits: u8) -> u32 {
    u32::from(index) << 16 | u32::from(sub) << 8 | u32::from(bits)
}

/// Writes an object of one, two or four bytes.
#[must_use]
pub fn write(node: u8, (index, sub): Object, bytes: u8, value: u32) -> Frame {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = value.to_le_bytes();
    let unused = 4 - bytes.clamp(1, 4);
    Frame::new(identifier(Service::SdoQuestion, node), &[0x23 | unused << 2, low, high, sub, a, b, c, d])
}

/// Asks for an object.
#[must_use]
pub fn ask(node: u8, (index, sub): Object) -> Frame {
    let [low, high] = index.to_le_bytes();
    Frame::new(identifier(Service::SdoQuestion, node), &[0x40, low, high, sub, 0, 0, 0, 0])
}

/// What a node answers about an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// It is written.
    Written(Object),
    /// It has this value.
    Value(Object, u32),
    /// No, for this reason.
    Abort(Object, u32),
}

/// The answer in the data of a frame.
#[must_use]
pub fn answer(data: &[u8]) -> Option<Answer> {
    let [command, low, high, sub, value @ ..] = <[u8; 8]>::try_from(data).ok()?;
    let object = (u16::from_le_bytes([low, high]), sub);
    let value = u32::from_le_bytes(value);
    match command {
        0x60 => Some(Answer::Written(object)),
        0x80 => Some(Answer::Abort(object, value)),
        // Expedited, with the number of unused bytes.
        0x43 | 0x47 | 0x4B | 0x4F => {
            Some(Answer::Value(object, value & (u32::MAX >> (8 * u32::from(command >> 2 & 3)))))
        }
        _ => None,
    }
}

/// Why an object was not read or written.
#[must_use]
pub fn abort_words(code: u32) -> String {
    let words = match code {
        0x0504_0000 => "timed out",
        0x0601_0000 => "access is not supported",
        0x0601_0001 => "it can only be written",
        0x0601_0002 => "it can only be read",
        0x0602_0000 => "there is no such object",
        0x0604_0041 => "it cannot be mapped",
        0x0604_0042 => "too much is mapped",
        0x0607_0010 => "its size is another",
        0x0609_0011 => "there is no such subindex",
        0x0609_0030 => "the value is not allowed",
        0x0800_0022 => "not in this state of the device",
        _ => return format!("error 0x{code:08X}"),
    };
    format!("{words} (0x{code:08X})")
}

/// State of a controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It starts.
    NotReadyToSwitchOn,
    /// Off.
    SwitchOnDisabled,
    /// Off, and may be switched on.
    ReadyToSwitchOn,
    /// With power, without torque.
    SwitchedOn,
    /// It does what it is told.
    OperationEnabled,
    /// It brakes.
    QuickStopActive,
    /// It stops because something is wrong.
    FaultReactionActive,
    /// Off, because something is wrong.
    Fault,
}

/// The state that a statusword says (table 2-5); `None`: none that there is.
#[must_use]
pub fn state(statusword: u16) -> Option<State> {
    // Bits 4 and 7 (voltage, warning) and the upper ones say other things.
    Some(match statusword & 0x6F {
        0x00 => State::NotReadyToSwitchOn,
        0x40 => State::SwitchOnDisabled,
        0x21 => State::ReadyToSwitchOn,
        0x23 => State::SwitchedOn,
        0x27 => State::OperationEnabled,
        0x07 => State::QuickStopActive,
        0x0F => State::FaultReactionActive,
        0x08 => State::Fault,
        _ => return None,
    })
}

/// Controlwords (table 2-7).
pub mod controlwords {
    /// Off, at once: the motor coasts.
    pub const DISABLE_VOLTAGE: u16 = 0x00;
    /// Off, and ready.
    pub const SHUTDOWN: u16 = 0x06;
    /// Power.
    pub const SWITCH_ON: u16 = 0x07;
    /// Torque.
    pub const ENABLE_OPERATION: u16 = 0x0F;
    /// A fault is forgotten, when the bit rises.
    pub const FAULT_RESET: u16 = 0x80;
}

/// The next controlword on the way to operation.
#[must_use]
pub fn toward_operation(state: Option<State>) -> u16 {
    match state {
        Some(State::SwitchOnDisabled) => controlwords::SHUTDOWN,
        Some(State::ReadyToSwitchOn) => controlwords::SWITCH_ON,
        Some(State::SwitchedOn | State::OperationEnabled) => controlwords::ENABLE_OPERATION,
        _ => controlwords::DISABLE_VOLTAGE,
    }
}

/// What an error of an emergency message means, in words.
#[must_use]
pub fn error_words(code: u16) -> &'static str {
    match code {
        0x1000 => "generic error",
        0x2310 | 0x2320 => "overcurrent",
        0x3210 => "overvoltage",
        0x3220 => "undervoltage",
        0x4210 => "excessive temperature",
        0x5113 | 0x5114 => "supply too low",
        0x6320 => "software parameter",
        0x7320 => "position sensor",
        0x8110 | 0x8111 => "CAN overrun",
        0x8130 => "the driver's heartbeat was lost",
        0x81FD => "CAN bus was off",
        0x8611 => "following error",
        0xFF01..=0xFFFF => "fault of the maker's own",
        _ => "see the controller's manual",
    }
}
