//! The quantities on which a torque may depend: one table for where a model fails, for laws without a name in a diagnosis, and for the search for
//! a law.

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
    formula: Formula,
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
#[must_use]
pub fn quantities<'r>(
    model: &PlatformModel,
    recordings: impl IntoIterator<Item = &'r Recording>,
) -> Vec<Quantity> {
    let recorded = recordings.into_iter().fold([true; 4], |all, run| {
        let slow = [&run.tank_pressure_pa, &run.bus_voltage_v, &run.temperature_k].map(|of| of.len() > 1);
        let commands = !run.wheel_torque_command_n_m.is_empty();
        [all[0] && slow[0], all[1] && slow[1], all[2] && slow[2], all[3] && commands]
    });
    let slow = [
        ("tank_pressure", "(pressure - reference_pressure)", "Pa"),
        ("bus_voltage", "(voltage - initial_voltage)", "V"),
        ("temperature", "(temperature - ambient_temperature)", "K"),
    ];
    let owned = |(name, text, unit): (&str, &str, &'static str)| (name.to_owned(), text.to_owned(), unit);
    let mut rows: Vec<(String, String, &'static str)> = COMMON.map(owned).to_vec();
    for (number, name) in (1..).zip(model.wheels().iter().map(|wheel| &wheel.name)) {
        rows.push((format!("{name}_speed"), format!("wheel_speed[{number}]"), "rad/s"));
        if recorded[3] {
            rows.push((format!("{name}_torque_command"), format!("motor_torque[{number}]"), "N m"));
        }
    }
    rows.extend(slow.into_iter().zip(recorded).filter(|(_, is)| *is).map(|(row, _)| owned(row)));
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
    /// Its value there, in its unit.
    #[must_use]
    pub fn number(&self, environment: &Environment<'_>) -> f64 {
        self.formula.number(environment)
    }

    /// The sign with which it has the sense of its name: a law has a coefficient of either sign.
    #[must_use]
    pub fn sense(&self) -> f64 {
        if self.name == "tilt_y" { -1.0 } else { 1.0 }
    }

    /// In words: "the yaw rate".
    #[must_use]
    pub fn words(&self) -> String {
        format!("the {}", self.name.replace('_', " "))
    }

    /// Whether it is an angle, of which laws are sines and cosines.
    #[must_use]
    pub fn is_angle(&self) -> bool {
        self.name == "yaw"
    }

    /// The axis of the body about which it is the rate.
    #[must_use]
    pub fn rate_axis(&self) -> Option<usize> {
        COMMON.iter().take(3).position(|row| row.0 == self.name)
    }

    /// Shapes of laws of it, in groups that explain together.
    pub fn shapes(&self) -> impl Iterator<Item = &'static [Shape]> + use<> {
        if self.is_angle() { HARMONICS.chunks(2) } else { SHAPES.chunks(1) }
    }

    /// Where shapes have their zero, and the unit of which they are functions, for values from `low` to `high`: half the largest size; of what
    /// wanders the middle, and half the range. None of what stays the same.
    #[must_use]
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
#[must_use]
pub fn environment<'a>(
    model: &'a PlatformModel,
    recording: &'a Recording,
    time_s: f64,
    (q_world_body, omega_b_rad_s): (UnitQuaternion<f64>, Vector3<f64>),
    wheel_speed_rad_s: &'a [f64],
) -> Environment<'a> {
    let last = |series: &Series<f64>| series.held_at(time_s).or(series.value.first()).copied().unwrap_or(0.0);
    let commands = &recording.wheel_torque_command_n_m;
    Environment {
        time_s,
        wheel_speed_rad_s,
        wheel_motor_torque_n_m: commands
            .held_at(time_s)
            .or(commands.value.first())
            .map_or(&[], Vec::as_slice),
        tank_pressure_pa: last(&recording.tank_pressure_pa),
        bus_voltage_v: last(&recording.bus_voltage_v),
        temperature_k: last(&recording.temperature_k),
        ..Environment::new(model, q_world_body, omega_b_rad_s)
    }
}
