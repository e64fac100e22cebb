//! What a model a little further along a parameter does otherwise in a state, where that shows at once.

use nalgebra::{Matrix3, Vector3, Vector6};
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::effects::{Effect, EffectKind, TrueImu};
use whorl_dynamics::gyrostat::Accelerations;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};

/// A model a little further along a parameter than another.
#[derive(Debug, Clone)]
pub struct Perturbed {
    /// The model.
    pub gyrostat: Gyrostat,
    /// A torque on the body besides, body axes [N m].
    outside_b_n_m: Vector3<f64>,
    step: f64,
    differs: Differs,
}

/// What a perturbed model does otherwise in one state, per unit of its parameter.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Difference {
    /// Acceleration of the body, body axes [rad/s^2].
    pub body_rad_s2: Vector3<f64>,
    /// Of each wheel relative to it [rad/s^2].
    pub wheels_rad_s2: [f64; MAX_WHEELS],
    /// Of what the gyro reads [rad/s].
    pub gyro_rad_s: Vector3<f64>,
}

/// A state of the model that is not perturbed, as effects see it, and how the model moves there.
#[derive(Debug, Clone)]
pub struct InState<'a> {
    environment: Environment<'a>,
    hidden: &'a [f64],
    accelerations: Accelerations,
    gyro_rad_s: Vector3<f64>,
    jets_rest: bool,
}

impl<'a> InState<'a> {
    /// Of a model in a state; the environment needs no angular acceleration.
    #[must_use]
    pub fn of(gyrostat: &'a Gyrostat, mut environment: Environment<'a>, hidden: &'a [f64]) -> Self {
        environment.omega_dot_wb_b_rad_s2 = Vector3::zeros();
        let accelerations = gyrostat.accelerations(&environment, hidden, &Vector3::zeros());
        environment.omega_dot_wb_b_rad_s2 = accelerations.omega_dot_wb_b_rad_s2;
        let gyro_rad_s = gyro_rad_s(gyrostat, &environment);
        let jets_rest = environment.valve_fraction.iter().all(|share| *share == 0.0);
        Self { environment, hidden, accelerations, gyro_rad_s, jets_rest }
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
        let (differs, _) = Differs::of(&gyrostat, of);
        shows.then_some(Self { gyrostat, outside_b_n_m: Vector3::zeros(), step, differs })
    }

    /// A model with this torque on the body per unit, body axes [N m].
    #[must_use]
    pub fn pushed(of: &Gyrostat, outside_b_n_m: Vector3<f64>) -> Self {
        Self { gyrostat: of.clone(), outside_b_n_m, step: 1.0, differs: Differs::InMotion }
    }

    /// What it does otherwise in a state.
    #[must_use]
    pub fn in_state(&self, of: &InState<'_>) -> Difference {
        let (mut environment, mut found) = (of.environment, Difference::default());
        environment.model = self.gyrostat.model();
        match self.differs {
            Differs::InJets if of.jets_rest => {}
            Differs::InReadings => {
                found.gyro_rad_s = (gyro_rad_s(&self.gyrostat, &environment) - of.gyro_rad_s) / self.step;
            }
            _ => {
                environment.omega_dot_wb_b_rad_s2 = Vector3::zeros();
                let own = self.gyrostat.accelerations(&environment, of.hidden, &self.outside_b_n_m);
                let of = &of.accelerations;
                found.body_rad_s2 = (own.omega_dot_wb_b_rad_s2 - of.omega_dot_wb_b_rad_s2) / self.step;
                let wheel = |j: usize| (own.wheel_rad_s2[j] - of.wheel_rad_s2[j]) / self.step;
                found.wheels_rad_s2 = std::array::from_fn(wheel);
            }
        }
        found
    }
}

/// What a gyro reads without noise, sensor axes.
fn gyro_rad_s(gyrostat: &Gyrostat, environment: &Environment<'_>) -> Vector3<f64> {
    let errors = &gyrostat.model().sensors.gyro.errors;
    errors.ideal(&gyrostat.true_imu(environment).angular_velocity_b_rad_s) + errors.bias
}

/// In what a varied model differs from the filter's: in what sensors read of the same motion, in a torque on the body or its wheels, in what jets do
/// while they push, anyhow; or its motion goes its own way within a step, by valves at other times, hidden states, another low-pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Differs {
    InReadings,
    InTorque,
    InJets,
    InMotion,
    WithinSteps,
}

impl Differs {
    /// Of a model that has the same valves and low-pass.
    pub fn of(own: &Gyrostat, other: &Gyrostat) -> (Self, Torque) {
        let (of, torque) = (other.model(), Torque::between(own, other));
        // Constants, as effects have corrected them.
        let alike = PlatformModel { effects: of.effects.clone(), ..own.model().clone() };
        let with_sensors = PlatformModel { sensors: of.sensors, ..alike.clone() };
        let with_mass = PlatformModel { mass_properties: of.mass_properties, ..alike.clone() };
        let same_mass = alike.mass_properties.mass_kg() == of.mass_properties.mass_kg();
        let effects = || torque.effects.iter().map(|(effect, ..)| *effect);
        let differs = if with_sensors == *of && effects().all(|e| e.info().kind == EffectKind::Sensor) {
            Self::InReadings
        // Corrections are in the constants already.
        } else if with_mass == *of
            && same_mass
            && effects().all(|e| e.is_correction() || e.info().kind == EffectKind::Torque)
        {
            Self::InTorque
        } else {
            // What jets do is part of their constants, whatever effect has made them so.
            let mut with_jets = with_sensors.clone();
            *with_jets.jets_mut() = of.jets().to_vec();
            if with_sensors != *of && with_jets == *of { Self::InJets } else { Self::InMotion }
        };
        (differs, torque)
    }
}

/// By how much the torque differs of a model that differs in nothing else: in inertia and gravity offset, in which the equation of motion is
/// linear, and in effects that make a torque.
#[derive(Debug, Clone, Default)]
pub(crate) struct Torque {
    /// Of the inertia [kg m^2] and the gravity offset [N m], body axes.
    inertia_b: Matrix3<f64>,
    offset_b: Vector3<f64>,
    /// Effects that are not in both models with the same values: 1 of the one, -1 of the other.
    effects: Vec<(&'static dyn Effect, Vec<f64>, f64)>,
}

impl Torque {
    pub fn between(own: &Gyrostat, other: &Gyrostat) -> Self {
        let [mass, of] = [own, other].map(|of| &of.model().mass_properties);
        let beyond = |own: &Gyrostat, other: &Gyrostat, sign: f64| {
            let all = other.effects();
            let has = |id: &str, values: &[f64]| {
                all.iter().any(|e| e.effect().info().id == id && e.values() == values)
            };
            let not_alike = own.effects().iter().filter(|e| !has(e.effect().info().id, e.values()));
            not_alike.map(|e| (e.effect(), e.values().to_vec(), sign)).collect::<Vec<_>>()
        };
        Self {
            inertia_b: mass.inertia_b_kg_m2() - of.inertia_b_kg_m2(),
            offset_b: mass.gravity_offset_b_n_m() - of.gravity_offset_b_n_m(),
            effects: [beyond(own, other, 1.0), beyond(other, own, -1.0)].concat(),
        }
    }

    /// On the body, body axes, and added to those on the wheels [N m], in a state with this angular acceleration; and what inertial sensors see more.
    pub fn in_state(&self, of: &Environment<'_>, wheels: &mut [f64]) -> (Vector3<f64>, Vector6<f64>) {
        let (omega, omega_dot) = (of.omega_wb_b_rad_s, of.omega_dot_wb_b_rad_s2);
        let (mut torque, mut seen) = (Vector3::zeros(), Vector6::zeros());
        if self.inertia_b != Matrix3::zeros() {
            torque -= self.inertia_b * omega_dot + omega.cross(&(self.inertia_b * omega));
        }
        if of.model.freedom.has_weight() {
            torque -= self.offset_b.cross(&of.vertical_b);
        }
        for (effect, values, sign) in self.effects.iter().filter(|(effect, ..)| !effect.is_correction()) {
            torque += effect.torque_b_n_m(values, of, &[]) * *sign;
            let mut of_wheels = [0.0; MAX_WHEELS];
            let slots = &mut of_wheels[..wheels.len().min(MAX_WHEELS)];
            effect.add_wheel_torque_n_m(values, of, slots);
            wheels.iter_mut().zip(slots).for_each(|(sum, of)| *sum += sign * *of);
            let (angular_velocity_b_rad_s, specific_force_b_m_s2) = (omega, Vector3::zeros());
            let mut imu = TrueImu { angular_velocity_b_rad_s, specific_force_b_m_s2 };
            effect.measure_imu(values, of, &mut imu);
            let rate = imu.angular_velocity_b_rad_s - omega;
            let more = rate.iter().chain(&imu.specific_force_b_m_s2);
            seen.iter_mut().zip(more).for_each(|(sum, more)| *sum += sign * more);
        }
        (torque, seen)
    }
}
