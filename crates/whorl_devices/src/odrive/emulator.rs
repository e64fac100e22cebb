//! An ODrive as it looks from its bus.

use std::f64::consts::TAU;

use super::Controllers;
use super::protocol::{CLOSED_LOOP, IDLE, Message, TORQUE_CONTROL, VELOCITY_CONTROL, identifier};
use crate::bus::Frame;
use crate::can_motors::{CanMotor, Emulated, Goal, Inside, Shaft};
use crate::emulation::{Emulator, World};

/// Between heartbeats \[ns\], as delivered.
const HEARTBEAT_NS: i64 = 100_000_000;
const WATCHDOG_EXPIRED: u32 = 1 << 24;

struct Axis {
    node: u8,
    watchdog_ns: i64,
    state: u32,
    error: u32,
    control: u32,
    /// As last commanded.
    torque_n_m: f64,
    speed_rad_s: f64,
    angle_rad: f64,
    heard_ns: i64,
    heartbeat_ns: i64,
}

pub(super) fn new(setup: &Controllers) -> Emulator {
    let host = setup.motors.emulated(&setup.heard());
    let watchdog_ns = (setup.motors.watchdog_s * 1e9) as i64;
    Emulated::emulator(&setup.motors, host, |motor: &CanMotor| Axis {
        node: motor.node,
        watchdog_ns,
        state: IDLE,
        error: 0,
        control: VELOCITY_CONTROL,
        torque_n_m: 0.0,
        speed_rad_s: 0.0,
        angle_rad: 0.0,
        heard_ns: i64::MIN,
        heartbeat_ns: i64::MIN,
    })
}

fn number(frame: &Frame, from: usize) -> Option<f64> {
    frame.bytes(from).map(|bytes| f64::from(f32::from_le_bytes(bytes)))
}

fn word(frame: &Frame, from: usize) -> Option<u32> {
    frame.bytes(from).map(u32::from_le_bytes)
}

impl Axis {
    fn goal(&self) -> Goal {
        match self.control {
            _ if self.state != CLOSED_LOOP => Goal::Off,
            TORQUE_CONTROL => Goal::Torque(self.torque_n_m),
            VELOCITY_CONTROL => Goal::Speed { speed_rad_s: self.speed_rad_s, torque_n_m: self.torque_n_m },
            _ => Goal::Torque(0.0),
        }
    }

    /// Carries out a message; `None`: it is not as it should be.
    fn carry_out(&mut self, message: Message, frame: &Frame) -> Option<()> {
        match message {
            Message::SetAxisState => {
                let state = word(frame, 0)?;
                // One with errors stays off.
                self.state = if state == CLOSED_LOOP && self.error == 0 { CLOSED_LOOP } else { IDLE };
            }
            Message::SetControllerMode => self.control = word(frame, 0)?,
            Message::SetInputTorque => self.torque_n_m = number(frame, 0)?,
            Message::SetInputVel => {
                (self.speed_rad_s, self.torque_n_m) = (number(frame, 0)? * TAU, number(frame, 4)?);
            }
            Message::ClearErrors => self.error = 0,
            Message::Heartbeat | Message::GetEncoderEstimates => {}
        }
        Some(())
    }
}

impl Inside for Axis {
    fn frame(&mut self, at_ns: i64, frame: &Frame, shaft: &mut Shaft, world: &mut World) -> Vec<Frame> {
        let Some(message) = Message::ALL.into_iter().find(|m| identifier(*m, self.node) == frame.id) else {
            return Vec::new();
        };
        self.heard_ns = at_ns;
        if message == Message::GetEncoderEstimates && frame.is_remote {
            let speed = shaft.measured(at_ns, world);
            let turns = [(self.angle_rad / TAU) as f32, (speed / TAU) as f32];
            let data: Vec<u8> = turns.into_iter().flat_map(f32::to_le_bytes).collect();
            return vec![Frame::new(frame.id, &data)];
        }
        let _ = self.carry_out(message, frame);
        shaft.goal = self.goal();
        if matches!(message, Message::SetInputTorque | Message::SetInputVel) && shaft.goal != Goal::Off {
            shaft.arrived(at_ns, world);
        }
        Vec::new()
    }

    fn tick(&mut self, now_ns: i64, shaft: &mut Shaft) -> Vec<Frame> {
        self.angle_rad += shaft.true_speed_rad_s * 1e-3;
        let is_late = self.watchdog_ns > 0 && now_ns.saturating_sub(self.heard_ns) > self.watchdog_ns;
        if is_late && self.state == CLOSED_LOOP {
            (self.state, self.error) = (IDLE, self.error | WATCHDOG_EXPIRED);
            shaft.goal = self.goal();
        }
        if now_ns < self.heartbeat_ns {
            return Vec::new();
        }
        self.heartbeat_ns = now_ns + HEARTBEAT_NS;
        let mut data = self.error.to_le_bytes().to_vec();
        data.extend([self.state as u8, 0, 0, 0]);
        vec![Frame::new(identifier(Message::Heartbeat, self.node), &data)]
    }
}
