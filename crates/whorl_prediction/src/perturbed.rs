//! What a model a little further along a parameter does otherwise in a state, where that shows at once.

use nalgebra::{Matrix3, Vector3, Vector6};
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::effects::{Effect, EffectKind, TrueImu};
use whorl_dynamics::gyrostat::Accelerations;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};

/// A model a little further along a parameter than another.
#[derive(Debug, Clone)]
pub struct Perturbed {
    gyrostat: Gyrostat,
    /// A torque on the body besides, body axes [N m].
    outside_b_n_m: Vector3<f64>,
    step: f64,
    differs: Differs,
}

/// What a perturbed model does otherwise in one state, per unit of its parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Difference {
    /// Nothing.
    None,
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

    /// The model.
    #[must_use]
    pub fn gyrostat(&self) -> &Gyrostat {
        &self.gyrostat
    }

    /// What it does otherwise in a state.
    #[must_use]
    pub fn in_state(&self, state: &InState<'_>) -> Difference {
        let mut environment = Environment { model: self.gyrostat.model(), ..state.environment };
        match self.differs {
            Differs::InJets if state.jets_rest => Difference::None,
            Differs::InReadings => {
                let reading = gyro_rad_s(&self.gyrostat, &environment);
                Difference::Gyro((reading - state.gyro_rad_s) / self.step)
            }
            _ => {
                environment.omega_dot_wb_b_rad_s2 = Vector3::zeros();
                let own = self.gyrostat.accelerations(&environment, state.hidden, &self.outside_b_n_m);
                let of = &state.accelerations;
                let wheels = |j: usize| (own.wheel_rad_s2[j] - of.wheel_rad_s2[j]) / self.step;
                Difference::Acceleration(
                    (own.omega_dot_wb_b_rad_s2 - of.omega_dot_wb_b_rad_s2) / self.step,
                    std::array::from_fn(wheels),
                )
            }
        }
    }
}

/// What a gyro reads without noise, sensor axes.
fn gyro_rad_s(gyrostat: &Gyrostat, environment: &Environment<'_>) -> Vector3<f64> {
    let errors = &gyrostat.model().sensors.gyro.errors;
    errors.ideal(&gyrostat.true_imu(environment).angular_velocity_b_rad_s) + errors.bias
}

/// In what a varied model differs from the filter's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Differs {
    /// Its motion goes its own way within a step: valves at other times, hidden states, another low-pass.
    WithinSteps,
    /// In what inertial and other sensors read of the same motion.
    InReadings,
    /// In a torque on the body or its wheels.
    InTorque,
    /// In what jets do while they push.
    InJets,
    /// Anyhow.
    InMotion,
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

/// By how much the torque differs with which a model moves that differs in nothing else: by the equation of motion, which is linear in
/// inertia and gravity offset, and by the effects that make a torque.
#[derive(Debug, Clone, Default)]
pub(crate) struct Torque {
    /// Of the inertia [kg m^2] and the gravity offset [N m], body axes.
    inertia_b: Matrix3<f64>,
    offset_b: Vector3<f64>,
    /// Effects with their values in the one model and in the other; empty: not in it.
    effects: Vec<(&'static dyn Effect, Vec<f64>, Vec<f64>)>,
}

impl Torque {
    pub fn between(own: &Gyrostat, other: &Gyrostat) -> Self {
        let [mass, of] = [own, other].map(|of| &of.model().mass_properties);
        let values = |gyrostat: &Gyrostat, id: &str| {
            let found = gyrostat.effects().iter().find(|e| e.effect().info().id == id);
            found.map_or_else(Vec::new, |e| e.values().to_vec())
        };
        let mut effects: Vec<(&'static dyn Effect, Vec<f64>, Vec<f64>)> = Vec::new();
        for effect in own.effects().iter().chain(other.effects().iter()).map(|e| e.effect()) {
            let id = effect.info().id;
            let pair = (values(own, id), values(other, id));
            if pair.0 != pair.1 && !effects.iter().any(|(known, ..)| known.info().id == id) {
                effects.push((effect, pair.0, pair.1));
            }
        }
        Self {
            inertia_b: mass.inertia_b_kg_m2() - of.inertia_b_kg_m2(),
            offset_b: mass.gravity_offset_b_n_m() - of.gravity_offset_b_n_m(),
            effects,
        }
    }

    /// On the body, body axes, and added to those on the wheels [N m], in a state with this angular acceleration; and what inertial sensors see more.
    pub fn in_state(
        &self,
        environment: &Environment<'_>,
        wheels: &mut [f64],
    ) -> (Vector3<f64>, Vector6<f64>) {
        let (omega, omega_dot) = (environment.omega_wb_b_rad_s, environment.omega_dot_wb_b_rad_s2);
        let (mut torque, mut seen) = (Vector3::zeros(), Vector6::zeros());
        if self.inertia_b != Matrix3::zeros() {
            torque -= self.inertia_b * omega_dot + omega.cross(&(self.inertia_b * omega));
        }
        if environment.model.freedom.has_weight() {
            torque -= self.offset_b.cross(&environment.vertical_b);
        }
        for (effect, own, other) in self.effects.iter().filter(|(effect, ..)| !effect.is_correction()) {
            for (values, sign) in [(own, 1.0), (other, -1.0)].into_iter().filter(|(of, _)| !of.is_empty()) {
                torque += effect.torque_b_n_m(values, environment, &[]) * sign;
                let mut of_wheels = [0.0; MAX_WHEELS];
                let slots = &mut of_wheels[..wheels.len().min(MAX_WHEELS)];
                effect.add_wheel_torque_n_m(values, environment, slots);
                wheels.iter_mut().zip(slots).for_each(|(sum, of)| *sum += sign * *of);
                let (angular_velocity_b_rad_s, specific_force_b_m_s2) = (omega, Vector3::zeros());
                let mut imu = TrueImu { angular_velocity_b_rad_s, specific_force_b_m_s2 };
                effect.measure_imu(values, environment, &mut imu);
                let rate = imu.angular_velocity_b_rad_s - omega;
                let of_imu = rate.iter().chain(&imu.specific_force_b_m_s2);
                seen.iter_mut().zip(of_imu).for_each(|(sum, of)| *sum += sign * of);
            }
        }
        (torque, seen)
    }
}
