//! A chain of Animatics SmartMotors on one RS-232 port that drive reaction wheels in torque mode (the dissertation's platforms,
//! section 4.1.1).
//!
//! Every motor passes on what it receives (`ECHO`) and its own answers, so that one port reaches all. Addresses and echo are
//! set by the motors' own program when they are switched on (guide, page 100). A cycle is one line for each motor's torque, one
//! `G` to all, which makes them act at the same instant, and one question for each speed; answers come in the order of the
//! questions. There is no checksum: a speed that no torque explains is refused.
//!
//! D-style motors take a share of the bus voltage, not a torque. Back EMF and the measured bus voltage are then allowed for
//! (the dissertation's section 4.1.1). Off is `OFF`, not `T=0`, which would brake.

mod drive;
mod emulator;
pub mod protocol;
mod session;
#[cfg(test)]
mod tests;

use std::time::Duration;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_params::{Reader, positive, range};

use crate::DeviceError;
use crate::bus::transmission;
use crate::device::{Address, Device, DeviceKind, Role};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;
pub use drive::Drive;
use protocol::LARGEST_ADDRESS;

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "smartmotor_chain",
    what: "Animatics SmartMotors (Class 5) on an RS-232 chain, torque mode: reaction wheels",
    read,
};

const BAUD: [i64; 7] = [2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200];
/// Bytes of a cycle for each motor at most: torque, question.
const CYCLE_BYTES: usize = 10 + 5;

/// One motor of the chain.
#[derive(Debug, Clone, PartialEq)]
struct Motor {
    /// Index of the wheel.
    wheel: usize,
    address: u8,
    /// -1: positive numbers turn the wheel against its axis.
    sign: f64,
    /// Largest change of its speed \[rad/s^2\], for refusing what cannot be.
    largest_acceleration: f64,
}

/// One chain.
#[derive(Debug, Clone)]
struct Chain {
    port: String,
    baud: u32,
    drive: Drive,
    counts_per_turn: f64,
    samples_per_s: f64,
    nominal_bus_v: f64,
    /// Between questions when no torques are asked for.
    period: Duration,
    /// The motors' own program switches off after so long without `G` \[s\]; 0: they have none.
    watchdog_s: f64,
    motors: Vec<Motor>,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let port = r.string("port", "serial port, such as /dev/whorl/wheels");
    let baud = r.i64_or(
        "baud",
        115_200,
        range(2400..=115_200),
        "rate of the serial port [bit/s], as the motors have it",
    );
    if !BAUD.contains(&baud) {
        r.reject(
            "baud",
            format!("the motors have no such rate; allowed: {}", BAUD.map(|b| b.to_string()).join(", ")),
        );
    }
    let style = r.choice_or(
        "drive",
        "voltage",
        &["voltage", "current"],
        "what T= is a share of: voltage (D-style) or current",
    );
    let drive = if style == "voltage" {
        Drive::Voltage {
            torque_constant: r.f64(
                "torque_constant_n_m_a",
                positive(),
                "torque per current [N m/A], from the motor's data sheet",
            ),
            resistance_ohm: r.f64(
                "resistance_ohm",
                positive(),
                "resistance of the winding, terminal to terminal [ohm]",
            ),
        }
    } else {
        let doc = "torque at T=32767 [N m]";
        Drive::Current { full_scale_torque_n_m: r.f64("full_scale_torque_n_m", positive(), doc) }
    };
    let counts_per_turn =
        r.f64_or("counts_per_turn", 4000.0, positive(), "encoder counts per turn, as RRES reports them");
    let samples_per_s = r.f64_or(
        "samples_per_s",
        8000.0,
        positive(),
        "samples per second of the motor's control, as RSAMP reports them [Hz]",
    );
    let watchdog_s = r.f64_or(
        "watchdog_s",
        0.2,
        range(0.0..=10.0),
        "the motors' own program switches them off so long after the last G [s]; 0: they have no such program",
    );
    let names: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let mut motors: Vec<Motor> = Vec::new();
    for name in r.children("motors") {
        let motor = r.group("motors", |r| r.group(&name, |r| read_motor(r, model, &names, &name)));
        let Some(motor) = motor else { continue };
        if let Some(other) = motors.iter().find(|other| other.address == motor.address) {
            let other = names.get(other.wheel).copied().unwrap_or_default();
            let problem = format!(
                "{other} has this address already; allowed: an address of its own, 1 to {LARGEST_ADDRESS}"
            );
            r.reject(&format!("motors.{name}.address"), problem);
        }
        motors.push(motor);
    }
    if motors.is_empty() && r.error_count() == before {
        r.reject(
            "kind",
            format!(
                "the chain drives nothing; allowed: motors.<wheel>.address for one or more of: {}",
                names.join(", ")
            ),
        );
    }
    let baud = u32::try_from(baud).unwrap_or(115_200);
    let rate_hz = model.sensors.rate_hz;
    let busy = rate_hz * transmission(motors.len() * CYCLE_BYTES + 3, baud).as_secs_f64();
    if busy > 0.9 && r.error_count() == before {
        let problem = format!(
            "{rate_hz} cycles a second for {} motors need {:.0} % of this rate; allowed: at most 90 %",
            motors.len(),
            busy * 100.0
        );
        r.reject("baud", problem);
    }
    (r.error_count() == before).then(|| {
        Box::new(Chain {
            port,
            baud,
            drive,
            counts_per_turn,
            samples_per_s,
            nominal_bus_v: model.bus.initial_v,
            period: Duration::from_secs_f64(1.0 / rate_hz),
            watchdog_s,
            motors,
        }) as Box<dyn Device>
    })
}

fn read_motor(r: &mut Reader<'_>, model: &PlatformModel, names: &[&str], name: &str) -> Option<Motor> {
    let wheel = names.iter().position(|known| *known == name);
    let address =
        r.i64("address", range(1..=i64::from(LARGEST_ADDRESS)), "address of the motor on its chain");
    let sign = r.i64_or(
        "sign",
        1,
        range(-1..=1),
        "-1: positive numbers turn the wheel against its spin_axis; whorl checkout finds it",
    );
    if sign == 0 {
        r.reject("sign", "allowed: 1 or -1");
    }
    let Some(wheel) = wheel else {
        r.reject("address", format!("{name} is no wheel of this platform; allowed: {}", names.join(", ")));
        return None;
    };
    let data = model.wheels().get(wheel)?;
    Some(Motor {
        wheel,
        address: u8::try_from(address).unwrap_or(1),
        sign: sign as f64,
        largest_acceleration: data.max_torque_n_m / data.spin_inertia_kg_m2,
    })
}

impl Device for Chain {
    fn addresses(&self) -> Vec<Address> {
        vec![Address(self.port.clone())]
    }

    fn path(&self) -> Option<&str> {
        Some(&self.port)
    }

    fn roles(&self) -> Vec<Role> {
        self.motors.iter().map(|motor| Role::Motor(Kind::Wheels, motor.wheel)).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        session::Session::open(self, place, reporter)?.run(mailbox)
    }

    fn emulator(&self, model: &PlatformModel) -> Emulator {
        emulator::new(self, model)
    }
}
