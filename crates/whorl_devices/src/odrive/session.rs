//! The driver's side of a bus with ODrive controllers.

use std::time::{Duration, Instant};

use super::protocol::{
    CLOSED_LOOP, Heartbeat, IDLE, Message, PASSTHROUGH, TORQUE_CONTROL, VELOCITY_CONTROL,
    ask_encoder_estimates, clear_errors, encoder_estimates, error_words, heartbeat, identifier,
    set_axis_state, set_controller_mode, set_input_torque, set_input_vel,
};
use crate::DeviceError;
use crate::bus::{Can, Frame};
use crate::can_motors::{CanMotors, Drives, Heard, Mode, Setpoint};

/// Between requests for a state that a controller does not have.
const AGAIN: Duration = Duration::from_millis(100);
/// Motors that are wanted are in closed loop after so long: heartbeats come every 0.1 s.
const TO_CLOSED_LOOP: Duration = Duration::from_millis(800);
/// A controller whose heartbeat has not come for so long says nothing of its state.
const NO_HEARTBEAT: Duration = Duration::from_secs(1);
/// Between attempts to forget errors, while motors are off.
const CLEAR_PERIOD: Duration = Duration::from_secs(1);

#[derive(Debug, Clone, Default)]
struct Node {
    heartbeat: Option<(Heartbeat, Instant)>,
    asked: Option<Instant>,
    cleared: Option<Instant>,
}

impl Node {
    fn state(&self) -> Option<u32> {
        self.heartbeat.map(|(beat, _)| u32::from(beat.state))
    }

    fn error(&self) -> u32 {
        self.heartbeat.map_or(0, |(beat, _)| beat.error)
    }
}

/// The controllers of a bus, as the driver sees them.
pub(super) struct Protocol<'a> {
    setup: &'a CanMotors,
    nodes: Vec<Node>,
    began: Instant,
    /// Since when motors are wanted.
    wanted: Option<Instant>,
}

impl<'a> Protocol<'a> {
    pub(super) fn new(setup: &'a CanMotors) -> Self {
        let nodes = vec![Node::default(); setup.motors.len()];
        Self { setup, nodes, began: Instant::now(), wanted: None }
    }
}

impl Drives for Protocol<'_> {
    fn start(&mut self, can: &mut Can) -> Result<(), DeviceError> {
        let nodes = self.setup.motors.iter().map(|motor| motor.node);
        let frames: Vec<Frame> =
            nodes.flat_map(|node| [set_axis_state(node, IDLE), clear_errors(node)]).collect();
        can.write(&frames)
    }

    fn cycle(&mut self, wanted: Option<&[Setpoint]>, now: Instant) -> Vec<Frame> {
        // The change to off goes out at once.
        let ends = wanted.is_none() && self.wanted.is_some();
        self.wanted = wanted.map(|_| self.wanted.unwrap_or(now));
        let target = if wanted.is_some() { CLOSED_LOOP } else { IDLE };
        let mut frames = Vec::new();
        for (index, (motor, node)) in self.setup.motors.iter().zip(&mut self.nodes).enumerate() {
            let setpoint = wanted.and_then(|all| all.get(index)).copied().unwrap_or_default();
            frames.push(match self.setup.mode {
                Mode::Torque => set_input_torque(motor.node, setpoint.torque_n_m),
                Mode::Speed => set_input_vel(motor.node, setpoint.speed_rad_s, setpoint.torque_n_m),
            });
            let is_due = node.asked.is_none_or(|asked| now >= asked + AGAIN);
            if ends || node.state() != Some(target) && is_due {
                node.asked = Some(now);
                if target == CLOSED_LOOP {
                    let control = match self.setup.mode {
                        Mode::Torque => TORQUE_CONTROL,
                        Mode::Speed => VELOCITY_CONTROL,
                    };
                    frames.push(set_controller_mode(motor.node, control, PASSTHROUGH));
                }
                frames.push(set_axis_state(motor.node, target));
            }
            let may_clear = node.cleared.is_none_or(|cleared| now >= cleared + CLEAR_PERIOD);
            if wanted.is_none() && node.error() != 0 && may_clear {
                node.cleared = Some(now);
                frames.push(clear_errors(motor.node));
            }
        }
        // Questions behind all commands, so that nothing holds these up.
        frames.extend(self.setup.motors.iter().map(|motor| ask_encoder_estimates(motor.node)));
        frames
    }

    fn heard(&mut self, frame: &Frame, now: Instant) -> Heard {
        if frame.is_remote {
            return Heard::Foreign;
        }
        for (index, (motor, node)) in self.setup.motors.iter().zip(&mut self.nodes).enumerate() {
            if frame.id == identifier(Message::GetEncoderEstimates, motor.node) {
                let Some((_, speed_rad_s)) = encoder_estimates(frame) else { return Heard::Refused };
                let is_off = node.state() != Some(CLOSED_LOOP);
                return Heard::Motion { motor: index, speed_rad_s, torque_n_m: is_off.then_some(0.0) };
            }
            if frame.id == identifier(Message::Heartbeat, motor.node) {
                let Some(beat) = heartbeat(frame) else { return Heard::Refused };
                node.heartbeat = Some((beat, now));
                return Heard::Noted;
            }
        }
        Heard::Foreign
    }

    fn fault(&self, now: Instant) -> Option<String> {
        let late = self.wanted.is_some_and(|since| now > since + TO_CLOSED_LOOP);
        let nodes = self.setup.motors.iter().zip(&self.nodes);
        let words: Vec<String> = nodes
            .filter_map(|(motor, node)| {
                let last = node.heartbeat.map_or(self.began, |(_, at)| at);
                let what = match node.heartbeat {
                    _ if now > last + NO_HEARTBEAT => "no heartbeat".to_owned(),
                    Some((beat, _)) if beat.error != 0 => error_words(beat.error),
                    Some((beat, _)) if late && u32::from(beat.state) != CLOSED_LOOP => format!(
                        "it does not begin to control: state {}, result {} of its last procedure (calibrated?)",
                        beat.state, beat.result
                    ),
                    _ => return None,
                };
                Some(format!("node {}: {what}", motor.node))
            })
            .collect();
        (!words.is_empty()).then(|| words.join("; "))
    }
}
