//! A CiA 402 controller as it looks from its bus: objects, process data as they are mapped, and the state machine.

use std::collections::BTreeMap;

use super::Controllers;
use super::protocol::{
    BOOT_UP, CYCLIC_TORQUE, NMT, Nmt, OPERATIONAL, Object, PDO_OFF, PRE_OPERATIONAL, PROFILE_VELOCITY, SYNC,
    Service, State, controlwords, heartbeat, identifier, objects, state,
};
use super::session::RAD_S_PER_MILLI_RPM;
use crate::bus::Frame;
use crate::can_motors::{CanMotor, Emulated, Goal, Inside, Shaft};
use crate::emulation::{Emulator, World};

/// Error of a controller that misses a heartbeat.
const HEARTBEAT_LOST: u16 = 0x8130;
const NO_OBJECT: u32 = 0x0602_0000;
const READ_ONLY: u32 = 0x0601_0002;
const NOT_ALLOWED: u32 = 0x0609_0030;
const OTHER_SIZE: u32 = 0x0607_0010;

/// Objects that it has: bytes, value after switching on, and whether they can be written. The rated torque is its own.
const OBJECTS: [(Object, u8, u32, bool); 30] = [
    ((0x1000, 0), 4, 0x0002_0192, false),
    (objects::CONSUMER_HEARTBEAT, 4, 0, true),
    (objects::PRODUCER_HEARTBEAT, 2, 0, true),
    (objects::RECEIVE_IDENTIFIER, 4, PDO_OFF, true),
    (objects::RECEIVE_TYPE, 1, 255, true),
    ((objects::RECEIVE_MAPPING, 0), 1, 0, true),
    ((objects::RECEIVE_MAPPING, 1), 4, 0, true),
    ((objects::RECEIVE_MAPPING, 2), 4, 0, true),
    ((objects::RECEIVE_MAPPING, 3), 4, 0, true),
    (objects::TRANSMIT_IDENTIFIER, 4, PDO_OFF, true),
    (objects::TRANSMIT_TYPE, 1, 255, true),
    ((objects::TRANSMIT_MAPPING, 0), 1, 0, true),
    ((objects::TRANSMIT_MAPPING, 1), 4, 0, true),
    ((objects::TRANSMIT_MAPPING, 2), 4, 0, true),
    ((objects::TRANSMIT_MAPPING, 3), 4, 0, true),
    ((objects::TRANSMIT_MAPPING, 4), 4, 0, true),
    (objects::ABORT_CONNECTION, 2, 1, true),
    (objects::CONTROLWORD, 2, 0, true),
    (objects::STATUSWORD, 2, 0x40, false),
    (objects::MODE, 1, 1, true),
    (objects::MODE_NOW, 1, 1, false),
    (objects::VELOCITY, 4, 0, false),
    (objects::TARGET_TORQUE, 2, 0, true),
    (objects::RATED_TORQUE, 4, 0, false),
    (objects::TORQUE, 2, 0, false),
    (objects::PROFILE_ACCELERATION, 4, 10_000, true),
    (objects::PROFILE_DECELERATION, 4, 10_000, true),
    // Turns a minute.
    (objects::VELOCITY_UNIT, 4, 0x00B4_4700, true),
    (objects::TARGET_VELOCITY, 4, 0, true),
    ((0x6085, 0), 4, 10_000, true),
];

pub(super) struct Controller {
    node: u8,
    rated_torque_n_m: f64,
    objects: BTreeMap<Object, (u8, u32, bool)>,
    communication: u8,
    /// Process data that wait for the next SYNC.
    waiting: Option<Frame>,
    /// When it has last heard the driver.
    heard_ns: Option<i64>,
    heartbeat_ns: i64,
    /// Controlword before.
    before: u16,
}

pub(super) fn new(setup: &Controllers) -> Emulator {
    let host = setup.motors.emulated(&setup.heard());
    Emulated::emulator(&setup.motors, host, |motor| Controller::new(motor, setup.rated_torque_n_m))
}

impl Controller {
    pub(super) fn new(motor: &CanMotor, rated_torque_n_m: f64) -> Self {
        let mut objects: BTreeMap<Object, (u8, u32, bool)> = OBJECTS
            .iter()
            .map(|(object, bytes, value, writable)| (*object, (*bytes, *value, *writable)))
            .collect();
        objects.insert(objects::RATED_TORQUE, (4, (rated_torque_n_m * 1e6).round() as u32, false));
        Self {
            node: motor.node,
            rated_torque_n_m,
            objects,
            // Switched on before anybody listens.
            communication: BOOT_UP,
            waiting: None,
            heard_ns: None,
            heartbeat_ns: 0,
            before: 0,
        }
    }

    /// The identifier of the heartbeat that it watches.
    fn watched(&self) -> u16 {
        let node = (self.value(objects::CONSUMER_HEARTBEAT) >> 16) as u8;
        if node == 0 { u16::MAX } else { identifier(Service::Heartbeat, node) }
    }

    fn value(&self, object: Object) -> u32 {
        self.objects.get(&object).map_or(0, |(_, value, _)| *value)
    }

    fn set(&mut self, object: Object, new: u32) {
        if let Some((_, value, _)) = self.objects.get_mut(&object) {
            *value = new;
        }
    }

    /// Answers a question about an object.
    fn question(&mut self, data: &[u8]) -> Option<Frame> {
        let [command, low, high, sub, value @ ..] = <[u8; 8]>::try_from(data).ok()?;
        let object = (u16::from_le_bytes([low, high]), sub);
        let (answer, value) = match self.carry_out(command, object, u32::from_le_bytes(value)) {
            Ok(answered) => answered,
            Err(code) => (0x80, code),
        };
        let [a, b, c, d] = value.to_le_bytes();
        let data = [answer, low, high, sub, a, b, c, d];
        Some(Frame::new(identifier(Service::SdoAnswer, self.node), &data))
    }

    /// Command byte and value of the answer, or why not.
    fn carry_out(&mut self, command: u8, object: Object, value: u32) -> Result<(u8, u32), u32> {
        let (bytes, now, writable) = *self.objects.get(&object).ok_or(NO_OBJECT)?;
        if command == 0x40 {
            return Ok((0x43 | (4 - bytes) << 2, now));
        }
        if command & 0xE3 != 0x23 || 4 - (command >> 2 & 3) != bytes {
            return Err(OTHER_SIZE);
        }
        if !writable {
            return Err(READ_ONLY);
        }
        let is_mode = [1, PROFILE_VELOCITY, 6, 8, 9, CYCLIC_TORQUE].contains(&value);
        if object == objects::MODE && !is_mode || object == objects::ABORT_CONNECTION && value > 3 {
            return Err(NOT_ALLOWED);
        }
        self.set(object, value);
        if object == objects::MODE {
            self.set(objects::MODE_NOW, value);
        }
        if object == objects::CONTROLWORD {
            self.control();
        }
        Ok((0x60, 0))
    }

    /// Its state machine.
    fn control(&mut self) {
        let word = self.value(objects::CONTROLWORD) as u16;
        let rises = word & controlwords::FAULT_RESET != 0 && self.before & controlwords::FAULT_RESET == 0;
        self.before = word;
        // Table 2-6, by the bits that count (table 2-7).
        let next = match (state(self.value(objects::STATUSWORD) as u16), word & 0x8F) {
            (Some(State::Fault), _) => {
                if rises {
                    State::SwitchOnDisabled
                } else {
                    State::Fault
                }
            }
            (Some(State::FaultReactionActive) | None, _) => State::Fault,
            (Some(_), bits) if bits & 0x82 == 0 => State::SwitchOnDisabled,
            (Some(State::SwitchOnDisabled | State::SwitchedOn | State::OperationEnabled), bits)
                if bits & 0x87 == 0x06 =>
            {
                State::ReadyToSwitchOn
            }
            (Some(State::OperationEnabled), bits) if bits & 0x86 == 0x02 => State::QuickStopActive,
            (Some(State::ReadyToSwitchOn), bits) if bits & 0x87 == 0x07 => State::SwitchedOn,
            (Some(State::SwitchedOn), 0x0F) => State::OperationEnabled,
            (Some(State::OperationEnabled), 0x07) => State::SwitchedOn,
            (Some(now), _) => now,
        };
        self.enter(next);
    }

    fn enter(&mut self, next: State) {
        let bits = match next {
            State::NotReadyToSwitchOn => 0x00,
            State::SwitchOnDisabled => 0x40,
            State::ReadyToSwitchOn => 0x21,
            State::SwitchedOn => 0x33,
            State::OperationEnabled => 0x37,
            State::QuickStopActive => 0x17,
            State::FaultReactionActive => 0x0F,
            State::Fault => 0x08,
        };
        // Remote: it listens to the bus.
        self.set(objects::STATUSWORD, 0x0200 | bits);
    }

    fn fail(&mut self, code: u16) -> Frame {
        self.enter(State::Fault);
        let [low, high] = code.to_le_bytes();
        Frame::new(identifier(Service::Emergency, self.node), &[low, high, 0x11, 0, 0, 0, 0, 0])
    }

    /// What its motor does in this state.
    fn goal(&self) -> Goal {
        if state(self.value(objects::STATUSWORD) as u16) != Some(State::OperationEnabled) {
            return Goal::Off;
        }
        match self.value(objects::MODE_NOW) {
            CYCLIC_TORQUE => {
                let thousandths = f64::from(self.value(objects::TARGET_TORQUE) as u16 as i16);
                Goal::Torque(thousandths / 1000.0 * self.rated_torque_n_m)
            }
            PROFILE_VELOCITY => {
                let speed = f64::from(self.value(objects::TARGET_VELOCITY) as i32);
                Goal::Speed { speed_rad_s: speed * self.velocity_unit(), torque_n_m: 0.0 }
            }
            _ => Goal::Torque(0.0),
        }
    }

    /// Of its speeds [rad/s]: a power of ten of a turn a minute.
    fn velocity_unit(&self) -> f64 {
        let [exponent, ..] = self.value(objects::VELOCITY_UNIT).to_be_bytes();
        RAD_S_PER_MILLI_RPM * 1000.0 * 10_f64.powi(i32::from(exponent as i8))
    }

    /// Objects of a mapping, and their bytes.
    fn mapping(&self, mapping: u16) -> Vec<(Object, usize)> {
        let count = self.value((mapping, 0)) as u8;
        let entries = (1..=count).map(|sub| self.value((mapping, sub)));
        entries.map(|m| (((m >> 16) as u16, (m >> 8) as u8), (m as u8 / 8) as usize)).collect()
    }

    /// Process data act.
    fn receive(&mut self, frame: &Frame) {
        let mut data = frame.data();
        for (object, bytes) in self.mapping(objects::RECEIVE_MAPPING) {
            // Too short: the controller ignores what is not there.
            let Some((head, tail)) = data.split_at_checked(bytes) else { return };
            let value = head.iter().rev().fold(0, |value: u32, byte| value << 8 | u32::from(*byte));
            self.set(object, value);
            data = tail;
        }
        self.control();
    }

    fn transmit(&self) -> Frame {
        let values = self.mapping(objects::TRANSMIT_MAPPING).into_iter();
        let bytes = values.flat_map(|(object, bytes)| {
            self.value(object).to_le_bytes().into_iter().take(bytes).collect::<Vec<u8>>()
        });
        let id = self.value(objects::TRANSMIT_IDENTIFIER) as u16;
        Frame::new(id, &bytes.collect::<Vec<u8>>())
    }

    fn measure(&mut self, at_ns: i64, shaft: &Shaft, world: &mut World) {
        let speed = (shaft.measured(at_ns, world) / self.velocity_unit()).round() as i32;
        let torque = (shaft.torque_n_m / self.rated_torque_n_m * 1000.0).round() as i16;
        self.set(objects::VELOCITY, speed as u32);
        self.set(objects::TORQUE, u32::from(torque as u16));
    }
}

impl Inside for Controller {
    fn frame(&mut self, at_ns: i64, frame: &Frame, shaft: &mut Shaft, world: &mut World) -> Vec<Frame> {
        let mut answers = Vec::new();
        let operational = self.communication == OPERATIONAL;
        if frame.id == NMT {
            match *frame.data() {
                [command, node] if node == self.node || node == 0 => {
                    if command == Nmt::Start as u8 {
                        self.communication = OPERATIONAL;
                    } else if command == Nmt::PreOperational as u8 {
                        (self.communication, self.waiting, self.heard_ns) = (PRE_OPERATIONAL, None, None);
                    }
                }
                _ => {}
            }
        } else if frame.id == identifier(Service::SdoQuestion, self.node) {
            if self.communication != BOOT_UP {
                self.measure(at_ns, shaft, world);
                answers.extend(self.question(frame.data()));
            }
        } else if frame.id == SYNC && operational {
            if let Some(waiting) = self.waiting.take() {
                self.receive(&waiting);
                shaft.goal = self.goal();
                if shaft.goal != Goal::Off {
                    shaft.arrived(at_ns, world);
                }
            }
            if self.value(objects::TRANSMIT_TYPE) == 1
                && self.value(objects::TRANSMIT_IDENTIFIER) & PDO_OFF == 0
            {
                self.measure(at_ns, shaft, world);
                answers.push(self.transmit());
            }
        } else if operational && u32::from(frame.id) == self.value(objects::RECEIVE_IDENTIFIER) {
            self.waiting = Some(*frame);
            if self.value(objects::RECEIVE_TYPE) == 255 {
                self.waiting = None;
                self.receive(frame);
            }
        } else if frame.id == self.watched() {
            self.heard_ns = Some(at_ns);
        }
        shaft.goal = self.goal();
        answers
    }

    fn tick(&mut self, now_ns: i64, shaft: &mut Shaft) -> Vec<Frame> {
        let mut frames = Vec::new();
        if self.communication == BOOT_UP {
            self.communication = PRE_OPERATIONAL;
            frames.push(heartbeat(self.node, BOOT_UP));
        }
        let period_ms = i64::from(self.value(objects::PRODUCER_HEARTBEAT));
        if period_ms > 0 && now_ns >= self.heartbeat_ns {
            self.heartbeat_ns = now_ns + period_ms * 1_000_000;
            frames.push(heartbeat(self.node, self.communication));
        }
        // A heartbeat is missed once it was heard.
        let patience_ms = i64::from(self.value(objects::CONSUMER_HEARTBEAT) & 0xFFFF);
        if patience_ms > 0 && self.heard_ns.is_some_and(|heard| now_ns > heard + patience_ms * 1_000_000) {
            self.heard_ns = None;
            self.set(objects::TARGET_TORQUE, 0);
            frames.push(self.fail(HEARTBEAT_LOST));
        }
        shaft.goal = self.goal();
        frames
    }
}
