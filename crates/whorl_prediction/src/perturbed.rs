//! What a model a little further along a parameter does otherwise in a state, where that shows at once.

use nalgebra::Vector3;
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::gyrostat::Accelerations;
use whorl_dynamics::{Environment, Gyrostat};

use crate::other::{Differs, Torque};

/// A model a little further along a parameter than another.
#[derive(Debug, Clone)]
pub struct Perturbed {
    gyrostat: Gyrostat,
    step: f64,
    differs: Differs,
    torque: Torque,
}

/// What a perturbed model does otherwise in one state, per unit of its parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Difference {
    /// Nothing.
    None,
    /// A torque on the body, body axes, and on each wheel, of which the body takes the opposite [N m].
    Torque(Vector3<f64>, [f64; MAX_WHEELS]),
    /// An acceleration of the body, body axes, and of each wheel relative to it [rad/s^2].
    Acceleration(Vector3<f64>, [f64; MAX_WHEELS]),
    /// The gyro reads so much more [rad/s].
    Gyro(Vector3<f64>),
}

/// A state of the model that is not perturbed, as effects see it, and how the model moves there.
#[derive(Debug, Clone)]
pub struct InState<'a> {
    environment: Environment<'a>,
    hidden: &'a [f64],
    gyrostat: &'a Gyrostat,
    accelerations: Accelerations,
    jet_torque_b_n_m: Vector3<f64>,
    gyro_rad_s: Vector3<f64>,
    jets_rest: bool,
}

impl<'a> InState<'a> {
    /// Of a model in a state; the environment needs no angular acceleration.
    #[must_use]
    pub fn of(gyrostat: &'a Gyrostat, mut environment: Environment<'a>, hidden: &'a [f64]) -> Self {
        let accelerations = gyrostat.accelerations(&environment, hidden, &Vector3::zeros());
        environment.omega_dot_wb_b_rad_s2 = accelerations.omega_dot_wb_b_rad_s2;
        Self {
            hidden,
            accelerations,
            jet_torque_b_n_m: gyrostat.jet_torque_b_n_m(&environment),
            gyro_rad_s: gyro_rad_s(gyrostat, &environment),
            jets_rest: environment.valve_fraction.iter().all(|share| *share == 0.0),
            gyrostat,
            environment,
        }
    }
}

impl Perturbed {
    /// A model so far along a parameter \[unit\] from another. `None` where what it does otherwise does not show in a state: it has
    /// other hidden states, valves that open at other times, or another low-pass.
    #[must_use]
    pub fn new(gyrostat: Gyrostat, step: f64, of: &Gyrostat) -> Option<Self> {
        let hidden = |of: &Gyrostat| of.effects().hidden_states();
        let low_pass_s = |of: &Gyrostat| of.model().sensors.gyro.errors.time_constant_s;
        let shows = hidden(&gyrostat) == hidden(of)
            && gyrostat.has_valves_of(of)
            && low_pass_s(&gyrostat) == low_pass_s(of);
        let (differs, torque) = (Differs::of(&gyrostat, of), Torque::between(&gyrostat, of));
        shows.then_some(Self { gyrostat, step, differs, torque })
    }

    /// The model.
    #[must_use]
    pub fn gyrostat(&self) -> &Gyrostat {
        &self.gyrostat
    }

    /// What it does otherwise in a state.
    #[must_use]
    pub fn in_state(&self, state: &InState<'_>) -> Difference {
        let per_unit = 1.0 / self.step;
        match self.differs {
            Differs::InJets if state.jets_rest => Difference::None,
            Differs::InJets => {
                let torque = self.gyrostat.jet_torque_b_n_m(&state.environment) - state.jet_torque_b_n_m;
                Difference::Torque(torque * per_unit, [0.0; MAX_WHEELS])
            }
            Differs::InTorque => {
                let mut wheels = [0.0; MAX_WHEELS];
                let count = state.gyrostat.model().wheels().len().min(MAX_WHEELS);
                let body = self.torque.in_state(&state.environment, &mut wheels[..count]);
                Difference::Torque(body * per_unit, wheels.map(|torque| torque * per_unit))
            }
            Differs::InReadings => {
                let reading = gyro_rad_s(&self.gyrostat, &self.environment(state));
                Difference::Gyro((reading - state.gyro_rad_s) * per_unit)
            }
            Differs::InMotion | Differs::WithinSteps => {
                let mut environment = self.environment(state);
                environment.omega_dot_wb_b_rad_s2 = Vector3::zeros();
                let own = self.gyrostat.accelerations(&environment, state.hidden, &Vector3::zeros());
                let of = &state.accelerations;
                let wheels = |j: usize| (own.wheel_rad_s2[j] - of.wheel_rad_s2[j]) * per_unit;
                Difference::Acceleration(
                    (own.omega_dot_wb_b_rad_s2 - of.omega_dot_wb_b_rad_s2) * per_unit,
                    std::array::from_fn(wheels),
                )
            }
        }
    }

    fn environment<'a>(&'a self, state: &InState<'a>) -> Environment<'a> {
        Environment { model: self.gyrostat.model(), ..state.environment }
    }
}

/// What a gyro reads without noise, sensor axes.
fn gyro_rad_s(gyrostat: &Gyrostat, environment: &Environment<'_>) -> Vector3<f64> {
    let errors = &gyrostat.model().sensors.gyro.errors;
    errors.ideal(&gyrostat.true_imu(environment).angular_velocity_b_rad_s) + errors.bias
}
