//! A session with a chain of motors.

use std::time::{Duration, Instant};

use whorl_dynamics::actuators::Kind;

use super::Chain;
use super::protocol::{ALL, Answer, FULL_SCALE, Replies, faults, line, speed_rad_s};
use crate::DeviceError;
use crate::bus::{Serial, transmission};
use crate::mailbox::{Command, Mailbox};
use crate::place::Place;
use crate::reading::{Joint, Measured, Reporter, State};

/// A chain that has not answered for so long is lost.
const SILENT: Duration = Duration::from_millis(100);
/// Between questions for the status.
const STATUS_PERIOD: Duration = Duration::from_secs(1);
/// A speed may differ from what the largest torque explains by this \[rad/s\], for noise and filters.
const GRACE_RAD_S: f64 = 2.0;
/// After so many refusals in a row a speed is believed: then the speed before was wrong.
const STUBBORN: u32 = 3;
const SPEED: &str = "RVA";
const STATUS: &str = "RW(0)";

pub(super) struct Session<'a> {
    chain: &'a Chain,
    reporter: &'a Reporter,
    serial: Serial,
    replies: Replies,
    /// Whether the motors are off, coasting.
    off: bool,
    /// Speed \[rad/s\] about the wheel's axis and when, what is commanded (share of full scale), refusals in a row, what is
    /// wrong; of each motor.
    motors: Vec<MotorState>,
    /// Speeds that have come in this cycle.
    fresh: Vec<bool>,
    asked: Option<Instant>,
    heard: Instant,
    status_due: Instant,
    told: Option<State>,
}

#[derive(Default, Clone)]
struct MotorState {
    speed: Option<(f64, Instant)>,
    share: f64,
    refusals: u32,
    fault: Option<String>,
}

impl<'a> Session<'a> {
    /// Opens the port, stops all motors, clears their faults and puts them into torque mode.
    pub(super) fn open(chain: &'a Chain, place: &Place, reporter: &'a Reporter) -> Result<Self, DeviceError> {
        let serial = Serial::open(&place.path(&chain.port), chain.baud)?;
        let now = Instant::now();
        let count = chain.motors.len();
        let mut session = Self {
            chain,
            reporter,
            serial,
            replies: Replies::default(),
            off: true,
            motors: vec![MotorState::default(); count],
            fresh: vec![false; count],
            asked: None,
            heard: now,
            status_due: now,
            told: None,
        };
        // Off is free, and not braked (page 605); inputs as inputs, so that open limit switches do not stop a wheel; faults
        // cleared (page 400).
        for command in ["BRKRLS", "OFF", "EIGN(W,0)", "ZS", "T=0", "MT"] {
            session.serial.write(&line(ALL, command))?;
        }
        Ok(session)
    }

    pub(super) fn run(mut self, mailbox: &Mailbox) -> Result<(), DeviceError> {
        let mut bytes = Vec::new();
        let mut next_question = Instant::now();
        loop {
            let woken = mailbox.wait(Some(self.serial.fd()), next_question.min(self.heard + SILENT));
            let mut torques = None;
            while let Some(command) = mailbox.take() {
                match command {
                    Command::Motors(Kind::Wheels, values) => torques = Some(values),
                    Command::AllOff => {
                        torques = None;
                        self.switch_off()?;
                    }
                    _ => {}
                }
            }
            if mailbox.is_closed() {
                return self.switch_off();
            }
            if woken.device {
                bytes.clear();
                self.serial.read(&mut bytes)?;
                let now = Instant::now();
                bytes.iter().for_each(|byte| {
                    if let Some(answer) = self.replies.push(*byte) {
                        self.answered(&answer, now);
                    }
                });
                self.reporter.refused(self.replies.take_refused());
            }
            let now = Instant::now();
            if let Some(torques) = &torques {
                self.command(torques)?;
            }
            // Right behind the torques, while nothing else is on the line; and without torques as often.
            let waits = self.asked.is_some_and(|asked| now < asked + SILENT / 4);
            if (torques.is_some() || now >= next_question) && !waits {
                self.ask(now)?;
                next_question = now + self.chain.period * if torques.is_some() { 2 } else { 1 };
            } else if now >= next_question {
                next_question = now + self.chain.period / 4;
            }
            if now >= self.heard + SILENT {
                let _ = self.switch_off();
                return Err(DeviceError::Silent(SILENT.as_secs_f64()));
            }
        }
    }

    fn switch_off(&mut self) -> Result<(), DeviceError> {
        self.off = true;
        self.motors.iter_mut().for_each(|motor| motor.share = 0.0);
        self.serial.write(&line(ALL, "OFF"))
    }

    fn command(&mut self, torques_n_m: &[f64]) -> Result<(), DeviceError> {
        let bus_v = self.bus_v();
        let mut bytes = Vec::new();
        if std::mem::replace(&mut self.off, false) {
            bytes.extend(line(ALL, "MT"));
        }
        for (motor, state) in self.chain.motors.iter().zip(&mut self.motors) {
            let torque = torques_n_m.get(motor.wheel).copied().unwrap_or(0.0);
            let speed = state.speed.map_or(0.0, |(speed, _)| speed);
            state.share = (self.chain.drive.share(torque, speed, bus_v) * FULL_SCALE).round() / FULL_SCALE;
            let number = (state.share * motor.sign * FULL_SCALE).round() as i64;
            bytes.extend(line(motor.address, &format!("T={number}")));
        }
        bytes.extend(line(ALL, "G"));
        self.serial.write(&bytes)
    }

    fn bus_v(&self) -> f64 {
        self.reporter.bus_voltage_v().filter(|volt| *volt > 1.0).unwrap_or(self.chain.nominal_bus_v)
    }

    fn ask(&mut self, now: Instant) -> Result<(), DeviceError> {
        let mut bytes = Vec::new();
        for motor in &self.chain.motors {
            bytes.extend(line(motor.address, SPEED));
        }
        if now >= self.status_due {
            self.status_due = now + STATUS_PERIOD;
            for motor in &self.chain.motors {
                bytes.extend(line(motor.address, STATUS));
            }
        }
        self.fresh.fill(false);
        self.asked = Some(now);
        self.serial.write(&bytes)
    }

    fn answered(&mut self, answer: &Answer, now: Instant) {
        let Some(index) = self.chain.motors.iter().position(|motor| motor.address == answer.address) else {
            return self.reporter.refused(1);
        };
        let (Some(motor), Some(state)) = (self.chain.motors.get(index), self.motors.get_mut(index)) else {
            return;
        };
        match answer.question.as_str() {
            STATUS => {
                state.fault = faults(answer.value);
                self.tell();
            }
            SPEED => {
                let speed = motor.sign
                    * speed_rad_s(answer.value, self.chain.counts_per_turn, self.chain.samples_per_s);
                let possible = state.speed.is_none_or(|(before, at)| {
                    let gap_s = now.saturating_duration_since(at).as_secs_f64();
                    (speed - before).abs() <= motor.largest_acceleration * gap_s + GRACE_RAD_S
                });
                if !possible && state.refusals < STUBBORN {
                    state.refusals += 1;
                    return self.reporter.refused(1);
                }
                (state.refusals, state.speed) = (0, Some((speed, now)));
                if let Some(fresh) = self.fresh.get_mut(index) {
                    *fresh = true;
                }
                if self.fresh.iter().all(|fresh| *fresh) {
                    self.complete(now);
                }
            }
            _ => self.reporter.refused(1),
        }
    }

    /// All speeds of a cycle are there.
    fn complete(&mut self, now: Instant) {
        (self.heard, self.asked) = (now, None);
        self.fresh.fill(false);
        if self.told.is_none() {
            self.tell();
        }
        let bus_v = self.bus_v();
        let motors = self.chain.motors.iter().zip(&self.motors).filter_map(|(motor, state)| {
            let (speed_rad_s, _) = state.speed?;
            let torque_n_m =
                if self.off { 0.0 } else { self.chain.drive.torque_n_m(state.share, speed_rad_s, bus_v) };
            Some(Joint { index: motor.wheel, angle_rad: None, speed_rad_s, torque_n_m })
        });
        // The last answer was on its way for so long; the others are older by a cycle's bytes.
        let on_its_way = transmission(8, self.chain.baud);
        let at = now.checked_sub(on_its_way).unwrap_or(now);
        self.reporter.measured(at, Measured::Motors { kind: Kind::Wheels, motors: motors.collect() });
    }

    fn tell(&mut self) {
        let faults = self.chain.motors.iter().zip(&self.motors);
        let words: Vec<String> = faults
            .filter_map(|(motor, state)| Some(format!("motor {}: {}", motor.address, state.fault.as_ref()?)))
            .collect();
        let state = if words.is_empty() { State::Ready } else { State::Fault(words.join("; ")) };
        if self.told.as_ref() != Some(&state) {
            self.told = Some(state.clone());
            self.reporter.state(state);
        }
    }
}
