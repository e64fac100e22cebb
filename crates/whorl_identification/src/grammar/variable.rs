//! Recorded quantities that a law may depend on.

use whorl_dynamics::effects::written::Formula;
use whorl_dynamics::{Environment, PlatformModel};
use whorl_recording::Recording;

/// A recorded quantity.
#[derive(Debug, Clone)]
pub(crate) struct Variable {
    /// Name in answers and in JSON, that of `whorl where`.
    pub name: String,
    /// Equation that gives it.
    pub text: String,
    /// Unit.
    pub unit: &'static str,
    /// In words.
    pub words: String,
    /// Largest size over all runs.
    pub largest: f64,
    /// It changes sign with the motion's.
    pub is_signed: bool,
    /// Body axis of which it is the rate.
    pub rate_axis: Option<usize>,
    /// Its zero is nobody's: it wanders over a run.
    pub is_slow: bool,
    /// What goes with it is fixed to the body.
    pub is_of_body: bool,
    formula: Formula,
}

impl Variable {
    /// Its value there, in its unit.
    pub fn number(&self, environment: &Environment<'_>) -> f64 {
        self.formula.number(environment)
    }
}

/// Quantities that the recordings hold, all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Recorded {
    pub pressure: bool,
    pub voltage: bool,
    pub temperature: bool,
    /// Torques of the wheels' motors.
    pub wheel_commands: bool,
}

impl Recorded {
    pub fn of<'r>(recordings: impl Iterator<Item = &'r Recording>) -> Self {
        let all = Self { pressure: true, voltage: true, temperature: true, wheel_commands: true };
        recordings.fold(all, |all, run| Self {
            pressure: all.pressure && run.tank_pressure_pa.len() > 1,
            voltage: all.voltage && run.bus_voltage_v.len() > 1,
            temperature: all.temperature && run.temperature_k.len() > 1,
            wheel_commands: all.wheel_commands && !run.wheel_torque_command_n_m.is_empty(),
        })
    }
}

/// Every quantity that recordings may hold.
pub(crate) fn possible(model: &PlatformModel, recorded: &Recorded) -> Vec<Variable> {
    let mut list = Vec::new();
    let mut add = |name: &str, text: &str, unit: &'static str, words: &str| {
        // Those of the table are equations, as a test shows.
        let Ok(formula) = Formula::new(text) else { return };
        let is_of_wheel = name.ends_with("_speed") || name.ends_with("_torque_command");
        list.push(Variable {
            name: name.to_owned(),
            text: text.to_owned(),
            unit,
            words: words.to_owned(),
            largest: 0.0,
            is_signed: !["rate", "tilt", "time"].contains(&name),
            rate_axis: RATES.iter().position(|rate| *rate == name),
            is_slow: matches!(name, "time" | "tank_pressure" | "bus_voltage" | "temperature"),
            is_of_body: name.ends_with("rate") || is_of_wheel || name == "tank_pressure",
            formula,
        });
    };
    for (name, text, words) in [
        (RATES[0], "rate.x", "the roll rate"),
        (RATES[1], "rate.y", "the pitch rate"),
        (RATES[2], "rate.z", "the yaw rate"),
        ("rate", "norm(rate)", "the size of the rate"),
    ] {
        add(name, text, "rad/s", words);
    }
    add("tilt_x", "vertical.y", "1", "the tilt about body x");
    // Its sense is the other one; a law has a coefficient of either sign.
    add("tilt_y", "vertical.x", "1", "the tilt about body y");
    add("tilt", "tilt", "rad", "the tilt");
    add("time", "time", "s", "time");
    for (j, wheel) in model.wheels().iter().enumerate() {
        let (name, number) = (&wheel.name, j + 1);
        let words = format!("the speed of {name}");
        add(&format!("{name}_speed"), &format!("wheel_speed[{number}]"), "rad/s", &words);
        if recorded.wheel_commands {
            let words = format!("the motor torque of {name}");
            add(&format!("{name}_torque_command"), &format!("motor_torque[{number}]"), "N m", &words);
        }
    }
    if recorded.pressure {
        add("tank_pressure", "(pressure - reference_pressure)", "Pa", "the tank pressure");
    }
    if recorded.voltage {
        add("bus_voltage", "(voltage - initial_voltage)", "V", "the bus voltage");
    }
    if recorded.temperature {
        add("temperature", "(temperature - ambient_temperature)", "K", "the temperature");
    }
    list
}

/// The variables that move in some run; `seen` has the largest size of each, run by run.
pub(crate) fn moving(list: Vec<Variable>, seen: &[Vec<f64>]) -> Vec<Variable> {
    let largest = |i: usize| seen.iter().filter_map(|run| run.get(i)).fold(0.0, |a: f64, b| a.max(*b));
    let sized = list.into_iter().enumerate().map(|(i, v)| Variable { largest: largest(i), ..v });
    sized.filter(|v| v.largest > 1e-9 && v.largest.is_finite()).collect()
}

/// Names of the rates about the body's axes.
const RATES: [&str; 3] = ["roll_rate", "pitch_rate", "yaw_rate"];

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    /// Each is an equation of the unit that it states, and its name is that of `whorl where`.
    #[test]
    fn quantities_have_their_units_and_the_names_of_where() {
        let model = PlatformModel::whorl_1_reference();
        let recorded = Recorded { pressure: true, voltage: true, temperature: true, wheel_commands: true };
        let all = possible(&model, &recorded);
        assert_eq!(all.len(), 8 + 2 * model.wheels().len() + 3);
        for variable in &all {
            let one = Formula::new(&format!("1 [{}]", variable.unit)).unwrap();
            assert_eq!(variable.formula.dimension(), one.dimension(), "{}", variable.name);
        }
        let q = UnitQuaternion::from_euler_angles(0.03, -0.02, 0.7);
        let environment = Environment::new(&model, q, Vector3::new(0.1, -0.2, 0.3));
        let state = whorl_prediction::SmoothedState {
            time_s: 0.0,
            q_world_body: q,
            attitude_stddev_b_rad: Vector3::zeros(),
            omega_wb_b_rad_s: environment.omega_wb_b_rad_s,
            omega_stddev_b_rad_s: Vector3::zeros(),
            wheel_speed_rad_s: vec![0.0; 3],
            wheel_speed_stddev_rad_s: vec![0.0; 3],
            torque_b_n_m: Vector3::zeros(),
            torque_covariance_b: nalgebra::Matrix3::zeros(),
            motor_torque_n_m: Vec::new(),
            motor_torque_stddev_n_m: Vec::new(),
        };
        let of_where = whorl_validation::dependence::conditions(&Recording::default(), &model, &[state]);
        for variable in all.iter().filter(|v| v.rate_axis.is_some() || v.name.starts_with("tilt")) {
            let other = of_where.iter().find(|other| other.name == variable.name).unwrap();
            // A component of the vertical is the angle but for the cube of the tilt.
            let off = variable.number(&environment).abs() - other.value[0].abs();
            assert!(off.abs() < 0.036_f64.powi(3), "{}: {off}", variable.name);
        }
    }
}
