//! A model a little further along a parameter, on the way of a filter.

use nalgebra::Vector3;
use whorl_dynamics::effects::EffectKind;
use whorl_dynamics::plant::Acts;
use whorl_dynamics::{Gyrostat, Plant, PlatformModel};

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
    /// Its vector sensors are others.
    pub turns_vectors: bool,
    /// What it does over the present step,
    pub does: Does,
    /// and how, where that shows in the filter's state: at every step in the same place.
    pub acts: Acts,
}

/// In what a varied model differs from the filter's.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Differs {
    /// Its motion goes its own way within a step: valves at other times, hidden states, another low-pass.
    WithinSteps,
    /// In what inertial and other sensors read of the same motion.
    InReadings,
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
        let acts = Acts::none(&with.plant);
        Ok(Self { with, step: varied.step, late_s, behind, differs, turns_vectors, does: Does::Step, acts })
    }

    /// As [`OtherModel::take_motion_of`].
    pub fn take_motion_of(&mut self, plant: &Plant, change: &[f64], instant_ns: i64) {
        self.with.take_motion_of(plant, change, instant_ns);
        self.behind.iter().for_each(|behind| self.with.plant.move_behind_filter(behind));
    }

    pub fn is_late(&self) -> bool {
        self.late_s != [0.0; 2]
    }
}

impl Differs {
    fn of(own: &Gyrostat, other: &Gyrostat) -> Self {
        // What no sensor does.
        let moving = |gyrostat: &Gyrostat| -> Vec<(&'static str, Vec<f64>)> {
            let all = gyrostat.effects().iter().filter(|e| e.effect().info().kind != EffectKind::Sensor);
            all.map(|e| (e.effect().info().id, e.values().to_vec())).collect()
        };
        // Constants, as effects have corrected them.
        let of = other.model();
        let mut alike =
            PlatformModel { sensors: of.sensors, effects: of.effects.clone(), ..own.model().clone() };
        if alike == *of {
            return if moving(own) == moving(other) { Self::InReadings } else { Self::InMotion };
        }
        // What jets do is part of their constants, whatever effect has made them so.
        *alike.jets_mut() = of.jets().to_vec();
        if alike == *of { Self::InJets } else { Self::InMotion }
    }
}
