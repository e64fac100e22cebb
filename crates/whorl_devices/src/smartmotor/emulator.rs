//! A chain of SmartMotors as it looks from its serial port, with wheels of the simulated platform on its shafts.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;

use super::protocol::{FULL_SCALE, address_of, reported_speed};
use super::{Chain, Drive};
use crate::bus::transmission;
use crate::emulation::{Emulator, SerialEmulator, Wire, World};

/// Between updates of the torque, which in a drive without current loop follows the speed \[ns\].
const UPDATE_NS: i64 = 1_000_000;
/// Longest command.
const LONGEST: usize = 64;

struct Emulated {
    chain: Chain,
    byte_ns: i64,
    motors: Vec<MotorInside>,
    update_ns: Option<i64>,
}

#[derive(Default, Clone)]
struct MotorInside {
    command: Vec<u8>,
    addressed: bool,
    torque_mode: bool,
    on: bool,
    /// Off is free; before that it is braked (guide, page 605).
    released: bool,
    /// As set, and as in force since `G`.
    target: f64,
    share: f64,
    started_ns: i64,
    /// RVA and its age: the motor measures once a control sample, of which the latest is reported.
    speed: i64,
}

pub(super) fn new(chain: &Chain, _: &PlatformModel) -> Emulator {
    Emulator::Serial {
        port: chain.port.clone(),
        baud: chain.baud,
        device: Box::new(Emulated {
            byte_ns: transmission(1, chain.baud).as_nanos() as i64,
            motors: vec![MotorInside::default(); chain.motors.len()],
            chain: chain.clone(),
            update_ns: None,
        }),
    }
}

impl Emulated {
    fn execute(&mut self, index: usize, at_ns: i64, world: &mut World, wire: &mut Wire) {
        let (Some(motor), Some(data)) = (self.motors.get_mut(index), self.chain.motors.get(index)) else {
            return;
        };
        let command = std::mem::take(&mut motor.command);
        let Ok(text) = std::str::from_utf8(&command) else { return };
        match text {
            "MT" => motor.torque_mode = true,
            "G" if motor.torque_mode => {
                (motor.on, motor.share, motor.started_ns) = (true, motor.target, at_ns);
                world.advance_to(at_ns);
                world.torque_arrived(at_ns);
                self.drive(at_ns, world);
            }
            "BRKRLS" => motor.released = true,
            "OFF" => {
                motor.on = false;
                world.advance_to(at_ns);
                self.drive(at_ns, world);
            }
            "RVA" => {
                world.advance_to(at_ns);
                let speeds = world.wheel_speeds(at_ns);
                let speed = data.sign
                    * world.sign_of_wheel(data.wheel)
                    * speeds.get(data.wheel).copied().unwrap_or(0.0);
                motor.speed = reported_speed(speed, self.chain.counts_per_turn, self.chain.samples_per_s);
                wire.send_message(at_ns, format!("{}\r", motor.speed).into_bytes());
            }
            // Ready; bit 1: off.
            "RW(0)" => wire.send_message(at_ns, format!("{}\r", 1 + 2 * u8::from(!motor.on)).into_bytes()),
            _ => {
                if let Some(number) = text.strip_prefix("T=").and_then(|number| number.parse::<i32>().ok()) {
                    motor.target = f64::from(number.clamp(-32767, 32767)) / FULL_SCALE;
                }
            }
        }
    }

    /// What the motors do now.
    fn drive(&mut self, now_ns: i64, world: &mut World) {
        let bus_v = world.bus_voltage_v();
        let watchdog_ns = (self.chain.watchdog_s * 1e9) as i64;
        for (motor, data) in self.motors.iter_mut().zip(&self.chain.motors) {
            if watchdog_ns > 0 && now_ns - motor.started_ns > watchdog_ns {
                motor.on = false;
            }
            let sign = data.sign * world.sign_of_wheel(data.wheel);
            let speed = world.true_wheel_speed(data.wheel);
            let torque = match self.chain.drive {
                drive if motor.on => drive.torque_n_m(motor.share * sign, speed, bus_v),
                // Its windings are shorted.
                drive @ Drive::Voltage { .. } if !motor.released => drive.torque_n_m(0.0, speed, bus_v),
                _ => 0.0,
            };
            world.set_motor(Kind::Wheels, data.wheel, torque);
        }
    }
}

impl SerialEmulator for Emulated {
    fn switched_on(&mut self, now_ns: i64) {
        self.motors.fill(MotorInside::default());
        self.update_ns = Some(now_ns);
    }

    fn byte(&mut self, at_ns: i64, byte: u8, world: &mut World, wire: &mut Wire) {
        // Every motor hands it on when it reads it; the last one to the computer.
        let behind_last = at_ns + self.byte_ns * self.motors.len() as i64;
        wire.send(behind_last, &[byte]);
        for index in 0..self.motors.len() {
            let here_ns = at_ns + self.byte_ns * index as i64;
            let (Some(motor), Some(data)) = (self.motors.get_mut(index), self.chain.motors.get(index)) else {
                continue;
            };
            if byte >= 0x80 {
                motor.addressed =
                    address_of(byte).is_some_and(|a| a == super::protocol::ALL || a == data.address);
                motor.command.clear();
            } else if [b'\r', b' '].contains(&byte) {
                if motor.addressed {
                    self.execute(index, here_ns, world, wire);
                }
            } else if motor.addressed && motor.command.len() < LONGEST {
                motor.command.push(byte);
            }
        }
    }

    fn due_ns(&self) -> Option<i64> {
        self.update_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World, _: &mut Wire) {
        let Some(due) = self.update_ns else { return };
        self.update_ns = Some((due + UPDATE_NS).max(now_ns));
        world.advance_to(now_ns);
        if matches!(self.chain.drive, Drive::Voltage { .. }) || self.chain.watchdog_s > 0.0 {
            self.drive(now_ns, world);
        }
    }
}
