//! Reaction wheels on motor controllers of a CAN bus, whatever their protocol: their parameters, a session that commands and
//! measures all of them in every cycle, and their emulation.
//!
//! A wheel is commanded by torque, or by speed where the controller has no torque that is worth its name: the speed is then the
//! integral of the torque over the wheel's inertia, and the controller's own loop takes care of drag and supply voltage.

#[cfg(test)]
pub(crate) mod bench;
mod emulator;
mod session;

use std::time::Duration;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_params::{Reader, range};

use crate::bus::{Bus, Frame};
use crate::device::Role;
pub(crate) use emulator::{Emulated, Goal, Inside, Shaft};
pub(crate) use session::{Drives, Heard, Setpoint, run};

const BIT_RATES: [i64; 7] = [50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];
/// Share of a bus's time that a cycle may take.
const BUSIEST: f64 = 0.7;

/// What a wheel is commanded by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Torque of the motor.
    Torque,
    /// Speed of the wheel.
    Speed,
}

/// One controller with its wheel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CanMotor {
    /// Index of the wheel.
    pub(crate) wheel: usize,
    pub(crate) node: u8,
    /// -1: positive numbers turn the wheel against its axis.
    pub(crate) sign: f64,
    pub(crate) inertia_kg_m2: f64,
    pub(crate) max_torque_n_m: f64,
    pub(crate) max_speed_rad_s: f64,
}

/// Controllers of one kind on one bus.
#[derive(Debug, Clone)]
pub(crate) struct CanMotors {
    pub(crate) bus: Bus,
    pub(crate) bit_rate: u32,
    pub(crate) mode: Mode,
    /// Between cycles when no torques are asked for.
    pub(crate) period: Duration,
    /// A controller switches its motor off by itself so long after it has last heard of the driver \[s\]; 0: it does not.
    pub(crate) watchdog_s: f64,
    pub(crate) motors: Vec<CanMotor>,
}

/// What a kind of controller is like.
pub(crate) struct Traits {
    /// Numbers that its nodes may have.
    pub(crate) nodes: std::ops::RangeInclusive<i64>,
    /// Data bytes of the frames of a cycle, of each motor, in both directions.
    pub(crate) cycle: &'static [usize],
    /// What `watchdog_s` is in words.
    pub(crate) watchdog: &'static str,
    /// Shortest watchdog \[s\].
    pub(crate) shortest_watchdog_s: f64,
}

impl CanMotors {
    /// Reads them from the open group. `None` when something was wrong, which the reader then holds.
    pub(crate) fn read(r: &mut Reader<'_>, model: &PlatformModel, traits: &Traits) -> Option<Self> {
        let before = r.error_count();
        let bus = Bus::read(r);
        let doc = "rate of the bus [bit/s], as its controllers and this computer's interface have it";
        let bit_rate = r.i64_or("bit_rate", 1_000_000, range(50_000..=1_000_000), doc);
        if !BIT_RATES.contains(&bit_rate) {
            let allowed = BIT_RATES.map(|rate| rate.to_string()).join(", ");
            r.reject("bit_rate", format!("CAN controllers have no such rate; allowed: {allowed}"));
        }
        let doc = "what wheels are commanded by: torque, or speed, the integral of the torque";
        let mode = match r.choice_or("mode", "torque", &["torque", "speed"], doc) {
            "speed" => Mode::Speed,
            _ => Mode::Torque,
        };
        let watchdog_s = r.f64_or("watchdog_s", 0.2, range(0.0..=10.0), traits.watchdog);
        if watchdog_s > 0.0 && watchdog_s < traits.shortest_watchdog_s {
            let shortest = traits.shortest_watchdog_s;
            r.reject("watchdog_s", format!("allowed: 0, or {shortest} and more, which is the driver's pace"));
        }
        let motors = read_motors(r, model, traits);
        let bit_rate = u32::try_from(bit_rate).unwrap_or(1_000_000);
        let rate_hz = model.sensors.rate_hz;
        let cycle_s: f64 = traits.cycle.iter().map(|n| Frame::longest(*n, bit_rate).as_secs_f64()).sum();
        let busy = rate_hz * cycle_s * motors.len() as f64;
        if busy > BUSIEST && r.error_count() == before {
            let problem = format!(
                "{rate_hz} cycles a second for {} motors need {:.0} % of this rate; allowed: at most {:.0} %",
                motors.len(),
                busy * 100.0,
                BUSIEST * 100.0
            );
            r.reject("bit_rate", problem);
        }
        let period = Duration::from_secs_f64(1.0 / rate_hz);
        (r.error_count() == before).then_some(Self { bus, bit_rate, mode, period, watchdog_s, motors })
    }

    pub(crate) fn roles(&self) -> Vec<Role> {
        self.motors.iter().map(|motor| Role::Motor(Kind::Wheels, motor.wheel)).collect()
    }

    /// The name of the socket of its emulator.
    pub(crate) fn emulated(&self, identifiers: &[u16]) -> String {
        self.bus.emulated(identifiers.iter().copied().max().unwrap_or(0))
    }
}

fn read_motors(r: &mut Reader<'_>, model: &PlatformModel, traits: &Traits) -> Vec<CanMotor> {
    let before = r.error_count();
    let names: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let mut motors: Vec<CanMotor> = Vec::new();
    for name in r.children("motors") {
        let (node, sign) = r.group("motors", |r| {
            r.group(&name, |r| {
                let node = r.i64("node", range(traits.nodes.clone()), "number of the controller on the bus");
                let doc =
                    "-1: positive numbers turn the wheel against its spin_axis; whorl checkout finds it";
                let sign = r.i64_or("sign", 1, range(-1..=1), doc);
                if sign == 0 {
                    r.reject("sign", "allowed: 1 or -1");
                }
                (node, sign)
            })
        });
        let node = u8::try_from(node).unwrap_or(0);
        let Some((wheel, data)) = model.wheels().iter().enumerate().find(|(_, wheel)| wheel.name == name)
        else {
            let problem = format!("{name} is no wheel of this platform; allowed: {}", names.join(", "));
            r.reject(&format!("motors.{name}.node"), problem);
            continue;
        };
        if let Some(other) = motors.iter().find(|other| other.node == node) {
            let other = names.get(other.wheel).copied().unwrap_or_default();
            let (first, last) = (traits.nodes.start(), traits.nodes.end());
            let problem =
                format!("{other} has this node already; allowed: a node of its own, {first} to {last}");
            r.reject(&format!("motors.{name}.node"), problem);
        }
        motors.push(CanMotor {
            wheel,
            node,
            sign: sign as f64,
            inertia_kg_m2: data.spin_inertia_kg_m2,
            max_torque_n_m: data.max_torque_n_m,
            max_speed_rad_s: data.max_speed_rad_s,
        });
    }
    if motors.is_empty() && r.error_count() == before {
        let names = names.join(", ");
        r.reject(
            "kind",
            format!("it drives nothing; allowed: motors.<wheel>.node for one or more of: {names}"),
        );
    }
    motors
}
