//! A model a little further along a parameter, on the way of a filter.

use nalgebra::{Matrix3, Vector3, Vector6};
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::effects::{Effect, EffectKind, TrueImu};
use whorl_dynamics::plant::Acts;
use whorl_dynamics::{Environment, Gyrostat, Plant, PlatformModel};

use crate::error::PredictionError;
use crate::prepared::{OtherModel, Prepared};

/// A model a little further along a parameter.
#[derive(Debug, Clone)]
pub struct Varied {
    /// The model there.
    pub model: PlatformModel,
    /// How far along the parameter, in its unit.
    pub step: f64,
}

/// A varied model on the way of a filter.
#[derive(Clone)]
pub(crate) struct Other<'a> {
    pub with: OtherModel<'a>,
    pub step: f64,
    /// How much later than the filter's model it takes the readings of gyro and accelerometer to be \[s\].
    pub late_s: [f64; 2],
    /// What is behind the sensors' low-pass less what is there with the filter's model, of a model with another low-pass.
    pub behind: Option<[Vector3<f64>; 2]>,
    pub differs: Differs,
    /// What differs, where that is a torque that can be told from the filter's state alone.
    pub torque: Torque,
    /// Its vector sensors are others.
    pub turns_vectors: bool,
    /// What it does over the present step,
    pub does: Does,
    /// and how, where that shows in the filter's state: at every step in the same place.
    pub acts: Acts,
    /// The torque on the body, body axes, and on the wheels that it makes more [N m],
    pub body_n_m: Vector3<f64>,
    pub wheels_n_m: [f64; MAX_WHEELS],
    /// and what inertial sensors see more by it.
    pub imu: Vector6<f64>,
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

/// What a varied model does over a step.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Does {
    /// What shows only when it has made the step.
    Step,
    /// What it does in the filter's state, until the end.
    Act,
    /// A torque more than the filter's model, until the end.
    Push,
    /// The same as the filter's model.
    TheSame,
}

impl<'a> Other<'a> {
    pub fn new(case: &Prepared<'a>, varied: &Varied) -> Result<Self, PredictionError> {
        let with = case.varied(&varied.model)?;
        let (sensors, of) = (&with.sensors, &case.model().sensors);
        let late_s = [
            sensors.gyro.errors.latency_s - of.gyro.errors.latency_s,
            sensors.accelerometer.errors.latency_s - of.accelerometer.errors.latency_s,
        ];
        let behind = with.has_own_low_pass.then(Default::default);
        let (own, of_case) = (with.plant.gyrostat(), case.plant().gyrostat());
        let turns_vectors = own.model().sensors.vector != of_case.model().sensors.vector;
        let differs =
            if with.has_own_low_pass || !own.model().gyros().is_empty() || !own.has_valves_of(of_case) {
                Differs::WithinSteps
            } else if turns_vectors {
                Differs::InMotion
            } else {
                Differs::of(own, of_case)
            };
        let torque = Torque::between(own, of_case);
        let acts = Acts::none(&with.plant);
        let does = Does::Step;
        let (body_n_m, wheels_n_m, imu) = (Vector3::zeros(), [0.0; MAX_WHEELS], Vector6::zeros());
        let step = varied.step;
        Ok(Self {
            with,
            step,
            late_s,
            behind,
            differs,
            torque,
            turns_vectors,
            does,
            acts,
            body_n_m,
            wheels_n_m,
            imu,
        })
    }

    /// As [`OtherModel::take_motion_of`].
    pub fn take_motion_of(&mut self, plant: &Plant, change: &[f64], instant_ns: i64) {
        self.with.take_motion_of(plant, change, instant_ns);
        self.behind.iter().for_each(|behind| self.with.plant.move_behind_filter(behind));
    }

    /// The same of a model that differs in a torque, with commands and supplies as well: those are the filter's, which was not followed
    /// while its torque alone was asked for.
    pub fn stand_in_for(&mut self, plant: &Plant, change: &[f64], event: usize) {
        self.with.plant.stand_in_for(plant, change);
        self.with.event = event;
    }

    /// Finds the torque that it makes more in the filter's state, of so many wheels.
    pub fn push(&mut self, environment: &Environment<'_>, wheels: usize) {
        self.wheels_n_m = [0.0; MAX_WHEELS];
        self.body_n_m = self.torque.in_state(environment, &mut self.wheels_n_m[..wheels.min(MAX_WHEELS)]);
        self.imu = self.torque.of_imu(environment);
        self.does = Does::Push;
    }

    pub fn is_late(&self) -> bool {
        self.late_s != [0.0; 2]
    }
}

impl Differs {
    /// Of a model that has the same valves and low-pass.
    pub fn of(own: &Gyrostat, other: &Gyrostat) -> Self {
        // What no sensor does.
        let moving = |gyrostat: &Gyrostat| -> Vec<(&'static str, Vec<f64>)> {
            let all = gyrostat.effects().iter().filter(|e| e.effect().info().kind != EffectKind::Sensor);
            all.map(|e| (e.effect().info().id, e.values().to_vec())).collect()
        };
        // Constants, as effects have corrected them.
        let of = other.model();
        let with_sensors_of =
            PlatformModel { sensors: of.sensors, effects: of.effects.clone(), ..own.model().clone() };
        if with_sensors_of == *of && moving(own) == moving(other) {
            return Self::InReadings;
        }
        if own.model().sensors == of.sensors && Torque::tells_all(own, other) {
            return Self::InTorque;
        }
        let mut alike = with_sensors_of;
        if alike == *of {
            return Self::InMotion;
        }
        // What jets do is part of their constants, whatever effect has made them so.
        *alike.jets_mut() = of.jets().to_vec();
        if alike == *of { Self::InJets } else { Self::InMotion }
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

    /// Whether nothing else of two models differs.
    fn tells_all(own: &Gyrostat, other: &Gyrostat) -> bool {
        let of = other.model();
        let same_mass = own.model().mass_properties.mass_kg() == of.mass_properties.mass_kg();
        let alike = PlatformModel {
            mass_properties: of.mass_properties,
            effects: of.effects.clone(),
            ..own.model().clone()
        };
        let is_torque = |(effect, ..): &(&'static dyn Effect, Vec<f64>, Vec<f64>)| {
            // Corrections are in the constants already.
            effect.is_correction() || effect.info().kind == EffectKind::Torque
        };
        same_mass && alike == *of && Self::between(own, other).effects.iter().all(is_torque)
    }

    /// On the body, body axes, and added to those on the wheels [N m], in a state with this angular acceleration.
    pub fn in_state(&self, environment: &Environment<'_>, wheels: &mut [f64]) -> Vector3<f64> {
        let (omega, omega_dot) = (environment.omega_wb_b_rad_s, environment.omega_dot_wb_b_rad_s2);
        let mut torque = Vector3::zeros();
        if self.inertia_b != Matrix3::zeros() {
            torque -= self.inertia_b * omega_dot + omega.cross(&(self.inertia_b * omega));
        }
        if environment.model.freedom.has_weight() {
            torque -= self.offset_b.cross(&environment.vertical_b);
        }
        for (effect, own, other) in &self.effects {
            for (values, sign) in [(own, 1.0), (other, -1.0)] {
                if values.is_empty() || effect.is_correction() {
                    continue;
                }
                torque += effect.torque_b_n_m(values, environment, &[]) * sign;
                let mut of_wheels = [0.0; MAX_WHEELS];
                let slots = &mut of_wheels[..wheels.len().min(MAX_WHEELS)];
                effect.add_wheel_torque_n_m(values, environment, slots);
                wheels.iter_mut().zip(slots).for_each(|(sum, of)| *sum += sign * *of);
            }
        }
        torque
    }

    /// Change of what inertial sensors see.
    pub fn of_imu(&self, environment: &Environment<'_>) -> Vector6<f64> {
        let mut change = Vector6::zeros();
        for (effect, own, other) in &self.effects {
            for (values, sign) in [(own, 1.0), (other, -1.0)] {
                if !values.is_empty() && !effect.is_correction() {
                    let mut imu = TrueImu {
                        angular_velocity_b_rad_s: environment.omega_wb_b_rad_s,
                        specific_force_b_m_s2: Vector3::zeros(),
                    };
                    effect.measure_imu(values, environment, &mut imu);
                    let rate = imu.angular_velocity_b_rad_s - environment.omega_wb_b_rad_s;
                    let mut own = change.fixed_rows_mut::<3>(0);
                    own += rate * sign;
                    let mut force = change.fixed_rows_mut::<3>(3);
                    force += imu.specific_force_b_m_s2 * sign;
                }
            }
        }
        change
    }
}
