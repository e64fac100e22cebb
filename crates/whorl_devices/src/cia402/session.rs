//! The driver's side of a bus with CiA 402 controllers.

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use super::Controllers;
use super::protocol::{
    Answer, BOOT_UP, CYCLIC_TORQUE, DISABLE_VOLTAGE, DRIVER, MILLI_RPM, Nmt, OPERATIONAL, Object, PDO_OFF,
    PROFILE_VELOCITY, SYNC, Service, State, abort_words, answer, ask, controlwords, error_words, heartbeat,
    identifier, mapped, nmt, objects, state, toward_operation, write,
};
use crate::DeviceError;
use crate::bus::{Can, Frame};
use crate::can_motors::{CanMotor, Drives, Heard, Mode, Setpoint};

/// A node has so long to answer about an object.
const ANSWER: Duration = Duration::from_millis(100);
/// It is asked so often: a frame may be lost where the bus is disturbed.
const ATTEMPTS: usize = 3;
/// Motors that are wanted are in operation after so long.
const TO_OPERATION: Duration = Duration::from_millis(500);
/// Between attempts to forget a fault, while motors are off.
const RESET_PERIOD: Duration = Duration::from_secs(1);
/// How often the driver's heartbeat comes within the controllers' patience.
const HEARTBEATS: f64 = 4.0;
/// The rated torque may differ from the list's by this share, for rounding.
const SAME_TORQUE: f64 = 0.02;

pub(super) const RAD_S_PER_MILLI_RPM: f64 = TAU / 60_000.0;

#[derive(Debug, Clone, Default)]
struct Node {
    status: Option<u16>,
    /// As its last emergency message says.
    error: Option<u16>,
    /// What rounding has left of the torque \[thousandths\].
    left: f64,
    controlword: u16,
    reset: Option<Instant>,
}

/// The controllers of a bus, as the driver sees them.
pub(super) struct Protocol<'a> {
    setup: &'a Controllers,
    nodes: Vec<Node>,
    /// Since when motors are wanted.
    wanted: Option<Instant>,
    heartbeat_due: Option<Instant>,
}

impl<'a> Protocol<'a> {
    pub(super) fn new(setup: &'a Controllers) -> Self {
        let nodes = vec![Node::default(); setup.motors.motors.len()];
        Self { setup, nodes, wanted: None, heartbeat_due: None }
    }

    fn set_up(&self, can: &mut Can, motor: &CanMotor) -> Result<(), DeviceError> {
        let node = motor.node;
        self.check_torque(can, node)?;
        let (mode, target, bits) = match self.setup.motors.mode {
            Mode::Torque => (CYCLIC_TORQUE, objects::TARGET_TORQUE, 16),
            Mode::Speed => (PROFILE_VELOCITY, objects::TARGET_VELOCITY, 32),
        };
        let receive = u32::from(identifier(Service::ReceivePdo, node));
        let transmit = u32::from(identifier(Service::TransmitPdo, node));
        let watchdog_ms = (self.setup.motors.watchdog_s * 1e3).round() as u32;
        let watched = if watchdog_ms == 0 { 0 } else { u32::from(DRIVER) << 16 | watchdog_ms };
        let rx = |sub| (objects::RECEIVE_MAPPING, sub);
        let tx = |sub| (objects::TRANSMIT_MAPPING, sub);
        let mut settings = vec![
            (objects::CONTROLWORD, 2, u32::from(controlwords::DISABLE_VOLTAGE)),
            (objects::ABORT_CONNECTION, 2, DISABLE_VOLTAGE),
            (objects::CONSUMER_HEARTBEAT, 4, watched),
            (objects::PRODUCER_HEARTBEAT, 2, 100),
            (objects::VELOCITY_UNIT, 4, MILLI_RPM),
            (objects::MODE, 1, mode),
            // Process data: off, what, when, on.
            (objects::RECEIVE_IDENTIFIER, 4, PDO_OFF | receive),
            (rx(0), 1, 0),
            (rx(1), 4, mapped(objects::CONTROLWORD, 16)),
            (rx(2), 4, mapped(target, bits)),
            (rx(0), 1, 2),
            (objects::RECEIVE_TYPE, 1, 1),
            (objects::RECEIVE_IDENTIFIER, 4, receive),
            (objects::TRANSMIT_IDENTIFIER, 4, PDO_OFF | transmit),
            (tx(0), 1, 0),
            (tx(1), 4, mapped(objects::STATUSWORD, 16)),
            (tx(2), 4, mapped(objects::VELOCITY, 32)),
            (tx(3), 4, mapped(objects::TORQUE, 16)),
            (tx(0), 1, 3),
            (objects::TRANSMIT_TYPE, 1, 1),
            (objects::TRANSMIT_IDENTIFIER, 4, transmit),
        ];
        if self.setup.motors.mode == Mode::Speed {
            // The speed that is commanded is the profile already: the controller's own must not be in its way.
            let rpm_s = motor.max_torque_n_m / motor.inertia_kg_m2 * 60.0 / TAU;
            let quick = (2.0 * rpm_s).ceil().max(1.0) as u32;
            settings.extend([
                (objects::PROFILE_ACCELERATION, 4, quick),
                (objects::PROFILE_DECELERATION, 4, quick),
            ]);
        }
        for (object, bytes, value) in settings {
            settle(can, node, &write(node, object, bytes, value), object)?;
        }
        Ok(())
    }

    /// The unit of object 0x6076 is mN m in the profile and uN m with some makers: the list says which is meant.
    fn check_torque(&self, can: &mut Can, node: u8) -> Result<(), DeviceError> {
        let object = objects::RATED_TORQUE;
        let rated = f64::from(settle(can, node, &ask(node, object), object)?.unwrap_or(0));
        let listed = self.setup.rated_torque_n_m;
        let is_listed = |torque_n_m: f64| (torque_n_m / listed - 1.0).abs() <= SAME_TORQUE;
        if is_listed(rated * 1e-3) || is_listed(rated * 1e-6) {
            return Ok(());
        }
        Err(DeviceError::Refused(format!(
            "node {node} has a rated torque (0x6076) of {rated}, in mN m or uN m; rated_torque_n_m says {listed} N m"
        )))
    }
}

/// Sends a frame about an object until there is an answer; gives the value if there is one.
fn settle(can: &mut Can, node: u8, frame: &Frame, object: Object) -> Result<Option<u32>, DeviceError> {
    for _ in 0..ATTEMPTS {
        can.write(std::slice::from_ref(frame))?;
        match hear_answer(can, node, object)? {
            Some(Answer::Value(_, value)) => return Ok(Some(value)),
            Some(Answer::Written(_)) => return Ok(None),
            Some(Answer::Abort((index, sub), code)) => {
                let words = abort_words(code);
                let problem = format!("node {node}, object 0x{index:04X} subindex {sub}: {words}");
                return Err(DeviceError::Refused(problem));
            }
            None => {}
        }
    }
    let seconds = ANSWER.as_secs_f64() * ATTEMPTS as f64;
    Err(DeviceError::Refused(format!("node {node} has not answered for {seconds:.1} s")))
}

/// The next answer about an object; `None`: none in time.
fn hear_answer(can: &mut Can, node: u8, object: Object) -> Result<Option<Answer>, DeviceError> {
    let until = Instant::now() + ANSWER;
    let from = identifier(Service::SdoAnswer, node);
    let mut frames = Vec::new();
    while Instant::now() < until {
        can.wait(until);
        frames.clear();
        can.read(&mut frames)?;
        let mut answers = frames.iter().filter(|frame| frame.id == from).filter_map(|f| answer(f.data()));
        let found = answers.find(|answered| match *answered {
            Answer::Written(of) | Answer::Value(of, _) | Answer::Abort(of, _) => of == object,
        });
        if found.is_some() {
            return Ok(found);
        }
    }
    Ok(None)
}

impl Drives for Protocol<'_> {
    fn start(&mut self, can: &mut Can) -> Result<(), DeviceError> {
        for motor in &self.setup.motors.motors {
            can.write(&[nmt(Nmt::PreOperational, motor.node)])?;
        }
        for motor in &self.setup.motors.motors {
            self.set_up(can, motor)?;
        }
        for motor in &self.setup.motors.motors {
            can.write(&[nmt(Nmt::Start, motor.node)])?;
        }
        Ok(())
    }

    fn cycle(&mut self, wanted: Option<&[Setpoint]>, now: Instant) -> Vec<Frame> {
        self.wanted = wanted.map(|_| self.wanted.unwrap_or(now));
        let mut frames = Vec::new();
        for (index, (motor, node)) in self.setup.motors.motors.iter().zip(&mut self.nodes).enumerate() {
            let at = node.status.and_then(state);
            let setpoint = wanted.and_then(|all| all.get(index)).copied();
            node.controlword = match setpoint {
                Some(_) => toward_operation(at),
                None if at == Some(State::Fault)
                    && node.reset.is_none_or(|last| now >= last + RESET_PERIOD) =>
                {
                    node.reset = Some(now);
                    controlwords::FAULT_RESET
                }
                None => controlwords::DISABLE_VOLTAGE,
            };
            let setpoint = setpoint.unwrap_or_default();
            let mut data = node.controlword.to_le_bytes().to_vec();
            match self.setup.motors.mode {
                Mode::Torque => {
                    let exact = setpoint.torque_n_m / self.setup.rated_torque_n_m * 1000.0 + node.left;
                    let thousandths = exact.round();
                    // What is left is made up for in the next cycle, and none of it where nothing is asked for.
                    node.left = if setpoint.torque_n_m == 0.0 { 0.0 } else { exact - thousandths };
                    data.extend((thousandths as i16).to_le_bytes());
                }
                Mode::Speed => {
                    data.extend(((setpoint.speed_rad_s / RAD_S_PER_MILLI_RPM).round() as i32).to_le_bytes());
                }
            }
            frames.push(Frame::new(identifier(Service::ReceivePdo, motor.node), &data));
        }
        frames.push(Frame::new(SYNC, &[]));
        let watchdog_s = self.setup.motors.watchdog_s;
        if watchdog_s > 0.0 && self.heartbeat_due.is_none_or(|due| now >= due) {
            self.heartbeat_due = Some(now + Duration::from_secs_f64(watchdog_s / HEARTBEATS));
            frames.push(heartbeat(DRIVER, OPERATIONAL));
        }
        frames
    }

    fn heard(&mut self, frame: &Frame, _: Instant) -> Heard {
        let nodes = self.setup.motors.motors.iter().zip(&mut self.nodes).enumerate();
        for (index, (motor, node)) in nodes {
            let is = |service| frame.id == identifier(service, motor.node);
            if is(Service::TransmitPdo) {
                let (Some(status), Some(speed), Some(torque)) =
                    (frame.bytes(0), frame.bytes(2), frame.bytes(6))
                else {
                    return Heard::Refused;
                };
                node.status = Some(u16::from_le_bytes(status));
                let torque = f64::from(i16::from_le_bytes(torque)) / 1000.0 * self.setup.rated_torque_n_m;
                // A speed that rises in steps has a torque that falls between them, and is always seen at the same place:
                // what was asked for is its mean.
                let is_mean = self.setup.motors.mode == Mode::Torque
                    || node.status.and_then(state) != Some(State::OperationEnabled);
                return Heard::Motion {
                    motor: index,
                    speed_rad_s: f64::from(i32::from_le_bytes(speed)) * RAD_S_PER_MILLI_RPM,
                    torque_n_m: is_mean.then_some(torque),
                };
            }
            if is(Service::Emergency) {
                let Some(code) = frame.bytes(0).map(u16::from_le_bytes) else { return Heard::Refused };
                node.error = Some(code).filter(|code| *code != 0);
                return Heard::Noted;
            }
            if is(Service::Heartbeat) {
                return match frame.data() {
                    [BOOT_UP] => Heard::Restarted(motor.node),
                    [_] => Heard::Noted,
                    _ => Heard::Refused,
                };
            }
        }
        Heard::Foreign
    }

    fn fault(&self, now: Instant) -> Option<String> {
        let late = self.wanted.is_some_and(|since| now > since + TO_OPERATION);
        let nodes = self.setup.motors.motors.iter().zip(&self.nodes);
        let words: Vec<String> = nodes
            .filter_map(|(motor, node)| {
                let at = node.status.and_then(state)?;
                let what = match (at, node.error) {
                    (State::Fault | State::FaultReactionActive, Some(code)) => {
                        format!("fault 0x{code:04X}, {}", error_words(code))
                    }
                    (State::Fault | State::FaultReactionActive, None) => "fault".to_owned(),
                    (State::OperationEnabled, _) => return None,
                    _ if late => format!("it does not begin to work: {at:?}"),
                    _ => return None,
                };
                Some(format!("node {}: {what}", motor.node))
            })
            .collect();
        (!words.is_empty()).then(|| words.join("; "))
    }
}
