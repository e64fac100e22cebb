//! A session with the motor controllers of a CAN bus.

use std::time::{Duration, Instant};

use whorl_dynamics::actuators::Kind;

use super::{CanMotors, Mode};
use crate::DeviceError;
use crate::bus::{Can, Frame};
use crate::mailbox::{Command, Mailbox};
use crate::place::Place;
use crate::reading::{Joint, Measured, Reporter, State};

/// Controllers that have not all answered for so long are lost.
const SILENT: Duration = Duration::from_millis(100);
/// No wheel turns so much quicker than its largest speed.
const IMPOSSIBLE: f64 = 3.0;
/// A speed that is commanded stays so close to the measured one: what the largest torque explains in this time \[s\].
const AHEAD_S: f64 = 0.2;

/// What a motor is to do, about its shaft.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Setpoint {
    pub(crate) torque_n_m: f64,
    /// With [`Mode::Speed`] \[rad/s\].
    pub(crate) speed_rad_s: f64,
}

/// What a frame has said.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Heard {
    /// How a motor turns about its shaft [rad/s], and what torque it makes \[N m\], if the controller knows.
    Motion { motor: usize, speed_rad_s: f64, torque_n_m: Option<f64> },
    /// Something about a motor's state.
    Noted,
    /// A controller must be set up again.
    Restarted(u8),
    /// Not for us.
    Foreign,
    /// For us, and not as it should be.
    Refused,
}

/// The protocol of a kind of controller.
pub(crate) trait Drives {
    /// Has all motors off, and sets the controllers up.
    fn start(&mut self, can: &mut Can) -> Result<(), DeviceError>;

    /// What is sent in a cycle: the motors' setpoints, or all off. Controllers answer with how the motors turn.
    fn cycle(&mut self, wanted: Option<&[Setpoint]>, now: Instant) -> Vec<Frame>;

    /// What a frame says.
    fn heard(&mut self, frame: &Frame, now: Instant) -> Heard;

    /// What is wrong with controllers or motors.
    fn fault(&self, now: Instant) -> Option<String>;
}

#[derive(Default, Clone, Copy)]
struct Motor {
    speed_rad_s: f64,
    torque_n_m: Option<f64>,
    is_fresh: bool,
    setpoint: Setpoint,
}

struct Session<'a, D> {
    setup: &'a CanMotors,
    drives: D,
    can: Can,
    reporter: &'a Reporter,
    motors: Vec<Motor>,
    is_on: bool,
    /// When torques have come last.
    commanded: Option<Instant>,
    heard: Instant,
    told: Option<State>,
}

/// Connects and serves until the mailbox is closed. Begins and ends with all motors off.
pub(crate) fn run<D: Drives>(
    setup: &CanMotors,
    mut drives: D,
    identifiers: &[u16],
    place: &Place,
    mailbox: &Mailbox,
    reporter: &Reporter,
) -> Result<(), DeviceError> {
    let mut can = Can::open(&setup.bus, place, identifiers, &setup.emulated(identifiers))?;
    drives.start(&mut can)?;
    let motors = vec![Motor::default(); setup.motors.len()];
    let heard = Instant::now();
    let mut session =
        Session { setup, drives, can, reporter, motors, is_on: false, commanded: None, heard, told: None };
    let result = session.serve(mailbox);
    session.is_on = false;
    // The last word, if anybody still listens.
    let off = session.cycle();
    result.and(off)
}

impl<D: Drives> Session<'_, D> {
    fn serve(&mut self, mailbox: &Mailbox) -> Result<(), DeviceError> {
        let mut next_cycle = Instant::now();
        let mut frames = Vec::new();
        loop {
            let woken = mailbox.wait(Some(self.can.fd()), next_cycle.min(self.heard + SILENT));
            let mut due = false;
            while let Some(command) = mailbox.take() {
                match command {
                    Command::Motors(Kind::Wheels, torques) => {
                        self.command(&torques);
                        due = true;
                    }
                    Command::AllOff => {
                        (self.is_on, self.commanded, due) = (false, None, true);
                    }
                    _ => {}
                }
            }
            if mailbox.is_closed() {
                return Ok(());
            }
            let now = Instant::now();
            if due || now >= next_cycle {
                // With torques a cycle behind each of them, and without as often.
                next_cycle = now + self.setup.period * if due { 2 } else { 1 };
                self.cycle()?;
            }
            if woken.device {
                frames.clear();
                self.can.read(&mut frames)?;
                self.reporter.refused(self.can.take_refused());
                for frame in &frames {
                    self.take(frame, now)?;
                }
            }
            self.tell(now);
            if now >= self.heard + SILENT {
                return Err(DeviceError::Silent(SILENT.as_secs_f64()));
            }
        }
    }

    fn cycle(&mut self) -> Result<(), DeviceError> {
        let setpoints: Vec<Setpoint> = self.motors.iter().map(|motor| motor.setpoint).collect();
        let wanted = Some(setpoints.as_slice()).filter(|_| self.is_on);
        let frames = self.drives.cycle(wanted, Instant::now());
        self.can.write(&frames)
    }

    /// What torques about the wheels' axes ask of each motor.
    fn command(&mut self, torques_n_m: &[f64]) {
        let now = Instant::now();
        let longest = self.setup.period * 2;
        let gap_s = self.commanded.replace(now).map_or(0.0, |last| (now - last).min(longest).as_secs_f64());
        let begins = !std::mem::replace(&mut self.is_on, true);
        for (data, motor) in self.setup.motors.iter().zip(&mut self.motors) {
            let wheel = torques_n_m.get(data.wheel).copied().filter(|torque| torque.is_finite());
            let largest = data.max_torque_n_m;
            let torque_n_m = data.sign * wheel.unwrap_or(0.0).clamp(-largest, largest);
            let mut speed_rad_s = if begins { motor.speed_rad_s } else { motor.setpoint.speed_rad_s };
            if self.setup.mode == Mode::Speed {
                // The torque of the last command has worked until now.
                let acted = if begins { 0.0 } else { motor.setpoint.torque_n_m };
                let ahead = largest / data.inertia_kg_m2 * AHEAD_S;
                speed_rad_s = (speed_rad_s + acted / data.inertia_kg_m2 * gap_s)
                    .clamp(motor.speed_rad_s - ahead, motor.speed_rad_s + ahead)
                    .clamp(-data.max_speed_rad_s, data.max_speed_rad_s);
            }
            motor.setpoint = Setpoint { torque_n_m, speed_rad_s };
        }
    }

    fn take(&mut self, frame: &Frame, now: Instant) -> Result<(), DeviceError> {
        match self.drives.heard(frame, now) {
            Heard::Motion { motor: index, speed_rad_s, torque_n_m } => {
                let (Some(data), Some(motor)) = (self.setup.motors.get(index), self.motors.get_mut(index))
                else {
                    return Ok(());
                };
                if !speed_rad_s.is_finite() || speed_rad_s.abs() > IMPOSSIBLE * data.max_speed_rad_s {
                    self.reporter.refused(1);
                    return Ok(());
                }
                (motor.speed_rad_s, motor.torque_n_m, motor.is_fresh) = (speed_rad_s, torque_n_m, true);
                if self.motors.iter().all(|motor| motor.is_fresh) {
                    self.complete(now);
                }
            }
            Heard::Refused => self.reporter.refused(1),
            Heard::Restarted(node) => {
                return Err(DeviceError::Refused(format!("node {node} was started again")));
            }
            Heard::Noted | Heard::Foreign => {}
        }
        Ok(())
    }

    /// All motors of a cycle are there.
    fn complete(&mut self, now: Instant) {
        self.heard = now;
        let motors = self.setup.motors.iter().zip(&mut self.motors).map(|(data, motor)| {
            motor.is_fresh = false;
            let commanded = if self.is_on { motor.setpoint.torque_n_m } else { 0.0 };
            Joint {
                index: data.wheel,
                angle_rad: None,
                speed_rad_s: data.sign * motor.speed_rad_s,
                torque_n_m: data.sign * motor.torque_n_m.unwrap_or(commanded),
            }
        });
        let motors = motors.collect();
        self.reporter.measured(now, Measured::Motors { kind: Kind::Wheels, motors });
        // From the first complete cycle on it answers.
        self.told.get_or_insert(State::Connecting);
    }

    fn tell(&mut self, now: Instant) {
        if self.told.is_none() {
            return;
        }
        let state = self.drives.fault(now).map_or(State::Ready, State::Fault);
        if self.told.as_ref() != Some(&state) {
            self.told = Some(state.clone());
            self.reporter.state(state);
        }
    }
}
