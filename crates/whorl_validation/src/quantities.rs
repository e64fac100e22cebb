//! The quantities on which a torque may depend: where a model fails, in laws without a name, and in the search for a law.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::effects::written::Formula;
use whorl_dynamics::{Environment, PlatformModel};
use whorl_recording::{Recording, Series};

use crate::shapes::{HARMONICS, SHAPES, Shape};

/// A quantity that recordings hold.
#[derive(Debug, Clone)]
pub struct Quantity {
    /// Name in answers and in JSON: `yaw_rate`, `wheel_x_speed`.
    pub name: String,
    /// Equation that gives it, with the grammar of effects.
    pub text: String,
    /// Unit.
    pub unit: &'static str,
    /// It changes sign with the motion's.
    pub is_signed: bool,
    /// Its zero is nobody's: it wanders over a run.
    pub is_slow: bool,
    /// What goes with it is fixed to the body.
    pub is_of_body: bool,
    /// Its value in a state, in its unit.
    pub formula: Formula,
}

/// Of the body and of time: name, equation, unit.
const COMMON: [(&str, &str, &str); 9] = [
    ("roll_rate", "rate.x", "rad/s"),
    ("pitch_rate", "rate.y", "rad/s"),
    ("yaw_rate", "rate.z", "rad/s"),
    ("rate", "norm(rate)", "rad/s"),
    ("tilt_x", "vertical.y", "1"),
    ("tilt_y", "vertical.x", "1"),
    ("tilt", "tilt", "rad"),
    ("yaw", "heading", "rad"),
    ("time", "time", "s"),
];

/// Every quantity that all of these recordings of a platform hold.
pub fn quantities<'r>(
    model: &PlatformModel,
    recordings: impl IntoIterator<Item = &'r Recording>,
) -> Vec<Quantity> {
    let runs: Vec<&Recording> = recordings.into_iter().collect();
    let all = |has: fn(&Recording) -> bool| runs.iter().all(|run| has(run));
    let slow = [
        ("tank_pressure", "(pressure - reference_pressure)", "Pa", all(|run| run.tank_pressure_pa.len() > 1)),
        ("bus_voltage", "(voltage - initial_voltage)", "V", all(|run| run.bus_voltage_v.len() > 1)),
        ("temperature", "(temperature - ambient_temperature)", "K", all(|run| run.temperature_k.len() > 1)),
    ];
    let owned = |(name, text, unit): (&str, &str, &'static str)| (name.to_owned(), text.to_owned(), unit);
    let mut rows: Vec<(String, String, &'static str)> = COMMON.map(owned).to_vec();
    for (number, wheel) in (1..).zip(model.wheels()) {
        rows.push((format!("{}_speed", wheel.name), format!("wheel_speed[{number}]"), "rad/s"));
        if all(|run| !run.wheel_torque_command_n_m.is_empty()) {
            rows.push((format!("{}_torque_command", wheel.name), format!("motor_torque[{number}]"), "N m"));
        }
    }
    rows.extend(slow.iter().filter(|of| of.3).map(|(name, text, unit, _)| owned((name, text, unit))));
    let quantity = |(name, text, unit): (String, String, &'static str)| {
        let is_of_wheel = name.ends_with("_speed") || name.ends_with("_torque_command");
        let is_slow = name == "time" || slow.iter().any(|(slow, ..)| *slow == name);
        Some(Quantity {
            // Those of the table are equations, as a test shows.
            formula: Formula::new(&text).ok()?,
            is_signed: !["rate", "tilt", "time"].contains(&name.as_str()),
            is_of_body: name.ends_with("rate") || is_of_wheel || name == "tank_pressure",
            is_slow,
            name,
            text,
            unit,
        })
    };
    rows.into_iter().filter_map(quantity).collect()
}

impl Quantity {
    /// In words: "the yaw rate".
    pub fn words(&self) -> String {
        format!("the {}", self.name.replace('_', " "))
    }

    /// Whether it is an angle, of which laws are sines and cosines.
    pub fn is_angle(&self) -> bool {
        self.name == "yaw"
    }

    /// The axis of the body about which it is the rate.
    pub fn rate_axis(&self) -> Option<usize> {
        COMMON.iter().take(3).position(|row| row.0 == self.name)
    }

    /// Shapes of laws of it, in groups that explain together.
    pub fn shapes(&self) -> impl Iterator<Item = &'static [Shape]> + use<> {
        if self.is_angle() { HARMONICS.chunks(2) } else { SHAPES.chunks(1) }
    }

    /// Where shapes have their zero, and the unit of which they are functions, for values from `low` to `high`: half the largest size; of what
    /// wanders the middle, and half the range. None of what stays the same.
    pub fn scale(&self, (low, high): (f64, f64)) -> Option<(f64, f64)> {
        if self.is_angle() {
            return Some((0.0, 1.0));
        }
        if !self.is_slow {
            return Some((0.0, 0.5 * high.max(-low).max(1e-9)));
        }
        let (centre, scale) = (0.5 * (low + high), 0.5 * (high - low));
        (scale > 1e-9 * centre.abs().max(1e-9)).then_some((centre, scale))
    }
}

/// What quantities are computed of, at an instant of a run \[s\] with this attitude (v_world = q v_body), rate of the body, body axes [rad/s], and
/// speeds of the wheels [rad/s]: channels have their last values.
pub fn environment<'a>(
    model: &'a PlatformModel,
    recording: &'a Recording,
    time_s: f64,
    (q_world_body, omega_b_rad_s): (UnitQuaternion<f64>, Vector3<f64>),
    wheel_speed_rad_s: &'a [f64],
) -> Environment<'a> {
    let last = |series: &Series<f64>| series.held_at(time_s).or(series.value.first()).copied().unwrap_or(0.0);
    let commands = &recording.wheel_torque_command_n_m;
    let command = commands.held_at(time_s).or(commands.value.first());
    Environment {
        time_s,
        wheel_speed_rad_s,
        wheel_motor_torque_n_m: command.map_or(&[], Vec::as_slice),
        tank_pressure_pa: last(&recording.tank_pressure_pa),
        bus_voltage_v: last(&recording.bus_voltage_v),
        temperature_k: last(&recording.temperature_k),
        ..Environment::new(model, q_world_body, omega_b_rad_s)
    }
}
