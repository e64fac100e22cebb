//! Motor controllers on a CAN bus as they look from its interface, with wheels of the simulated platform on their shafts.

use std::collections::VecDeque;

use whorl_dynamics::actuators::Kind;

use super::{CanMotor, CanMotors};
use crate::bus::{Frame, Record, Records};
use crate::emulation::{Emulator, TcpEmulator, Wire, World};

/// Between updates of the controllers \[ns\].
pub(crate) const UPDATE_NS: i64 = 1_000_000;
/// Time constant of their speed loops \[s\]; assumed.
const SPEED_LOOP_S: f64 = 0.01;

/// What a controller makes of its motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Goal {
    /// Without current: it coasts.
    Off,
    /// This torque \[N m\].
    Torque(f64),
    /// This speed [rad/s], with this torque besides what the loop asks for \[N m\].
    Speed { speed_rad_s: f64, torque_n_m: f64 },
}

/// A motor with its wheel.
pub(crate) struct Shaft {
    data: CanMotor,
    pub(crate) goal: Goal,
    /// What it makes now, about the shaft \[N m\].
    pub(crate) torque_n_m: f64,
    /// How it turns, about the shaft [rad/s].
    pub(crate) true_speed_rad_s: f64,
}

impl Shaft {
    /// As its encoder measures, about the shaft [rad/s].
    pub(crate) fn measured(&self, at_ns: i64, world: &mut World) -> f64 {
        world.advance_to(at_ns);
        let speed = world.wheel_speeds(at_ns).get(self.data.wheel).copied().unwrap_or(0.0);
        self.turn(world) * speed
    }

    /// A new setpoint has come to a motor that is on.
    pub(crate) fn arrived(&self, at_ns: i64, world: &mut World) {
        world.torque_arrived(at_ns);
    }

    /// Which way its wheel turns when it does.
    fn turn(&self, world: &World) -> f64 {
        self.data.sign * world.sign_of_wheel(self.data.wheel)
    }

    fn drive(&mut self, now_ns: i64, world: &mut World) {
        world.advance_to(now_ns);
        let turn = self.turn(world);
        self.true_speed_rad_s = turn * world.true_wheel_speed(self.data.wheel);
        let largest = self.data.max_torque_n_m;
        let torque = match self.goal {
            Goal::Off => 0.0,
            Goal::Torque(torque) => torque,
            Goal::Speed { speed_rad_s, torque_n_m } => {
                let error = speed_rad_s - self.true_speed_rad_s;
                torque_n_m + self.data.inertia_kg_m2 * error / SPEED_LOOP_S
            }
        };
        self.torque_n_m = torque.clamp(-largest, largest);
        world.set_motor(Kind::Wheels, self.data.wheel, turn * self.torque_n_m);
    }
}

/// One controller.
pub(crate) trait Inside: Send {
    /// A frame was on the bus.
    fn frame(&mut self, at_ns: i64, frame: &Frame, shaft: &mut Shaft, world: &mut World) -> Vec<Frame>;

    /// A millisecond has passed.
    fn tick(&mut self, now_ns: i64, shaft: &mut Shaft) -> Vec<Frame>;
}

/// All of them, and the bus.
pub(crate) struct Emulated<I> {
    bit_rate: u32,
    records: Records,
    /// Frames to the controllers, and when they are complete on the bus.
    toward: VecDeque<(i64, Frame)>,
    /// When the bus is free.
    free_ns: i64,
    update_ns: i64,
    nodes: Vec<(I, Shaft)>,
}

impl<I: Inside + 'static> Emulated<I> {
    /// Controllers behind the socket of that name.
    pub(crate) fn emulator(setup: &CanMotors, host: String, inside: impl Fn(&CanMotor) -> I) -> Emulator {
        let shaft = |data: &CanMotor| Shaft {
            data: data.clone(),
            goal: Goal::Off,
            torque_n_m: 0.0,
            true_speed_rad_s: 0.0,
        };
        let nodes = setup.motors.iter().map(|data| (inside(data), shaft(data))).collect();
        let device = Self {
            bit_rate: setup.bit_rate,
            records: Records::default(),
            toward: VecDeque::new(),
            free_ns: i64::MIN,
            update_ns: i64::MIN,
            nodes,
        };
        Emulator::Tcp { host, device: Box::new(device) }
    }

    /// When a frame that waits from this time on is complete on the bus.
    fn occupy(&mut self, from_ns: i64, frame: &Frame) -> i64 {
        self.free_ns = self.free_ns.max(from_ns) + frame.duration(self.bit_rate).as_nanos() as i64;
        self.free_ns
    }

    fn answer(&mut self, from_ns: i64, frames: Vec<Frame>, wire: &mut Wire) {
        for frame in frames {
            let at_ns = self.occupy(from_ns, &frame);
            wire.send_checked(at_ns, frame.record().to_vec());
        }
    }
}

impl<I: Inside + 'static> TcpEmulator for Emulated<I> {
    fn connected(&mut self) {
        self.records.clear();
        self.toward.clear();
    }

    fn bytes(&mut self, at_ns: i64, bytes: &[u8], _: &mut World, _: &mut Wire) -> Result<(), &'static str> {
        self.records.push(bytes);
        while let Some(record) = self.records.next_record() {
            if let Record::Frame(frame) = record {
                let complete_ns = self.occupy(at_ns, &frame);
                self.toward.push_back((complete_ns, frame));
            }
        }
        Ok(())
    }

    fn due_ns(&self) -> Option<i64> {
        let frame = self.toward.front().map(|(at, _)| *at);
        [frame, Some(self.update_ns)].into_iter().flatten().min()
    }

    fn act(&mut self, now_ns: i64, world: &mut World, wire: &mut Wire) {
        while let Some((at_ns, frame)) = self.toward.front().copied().filter(|(at_ns, _)| *at_ns <= now_ns) {
            self.toward.pop_front();
            let mut answers = Vec::new();
            for (inside, shaft) in &mut self.nodes {
                let before = shaft.goal;
                answers.extend(inside.frame(at_ns, &frame, shaft, world));
                if shaft.goal != before {
                    shaft.drive(now_ns, world);
                }
            }
            self.answer(at_ns, answers, wire);
        }
        if now_ns >= self.update_ns {
            self.update_ns = now_ns + UPDATE_NS;
            let mut frames = Vec::new();
            for (inside, shaft) in &mut self.nodes {
                frames.extend(inside.tick(now_ns, shaft));
                shaft.drive(now_ns, world);
            }
            self.answer(now_ns, frames, wire);
        }
    }
}
