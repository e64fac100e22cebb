//! What an identification may change, in units of what was known before, and the model at its values.

use nalgebra::DVector;
use whorl_dynamics::effects::{BasePrior, Need, Part, catalogue};
use whorl_dynamics::{Effect, Gyrostat, ModelPrior, ParameterSpec, PlatformModel};
use whorl_prediction::Parameter;
use whorl_recording::Recording;

use whorl_dynamics::mass_parameters::{
    MASS_PARAMETERS, MassCovariance, MassVector, mass_properties, mass_vector, prior_stddev,
};
use whorl_dynamics::realisability::nearest_realisable;

/// What a parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// One of the nine, by its position.
    Mass(usize),
    /// An effect that the model has.
    OfModel,
    /// An effect that the model does not have and no platform is without.
    Beside,
    /// A constant of wheels, jets or gyros.
    Actuator,
}

/// A parameter that the prior leaves open.
#[derive(Debug, Clone)]
pub(crate) struct Free {
    pub kind: Kind,
    /// The effect and its parameter; none of the nine.
    pub of: Option<(&'static dyn Effect, ParameterSpec)>,
    /// Value in the given model, an effect's neutral one where it has none.
    pub given: f64,
    /// What is known of it before, > 0: one unit.
    pub stddev: f64,
}

impl Free {
    /// Its value so many units from the given one.
    pub fn value(&self, units: f64) -> f64 {
        let value = self.given + units * self.stddev;
        self.of.as_ref().map_or(value, |(_, spec)| spec.limited(value))
    }

    fn known(&self) -> Parameter {
        let range = match &self.of {
            Some((_, spec)) if spec.period.is_none() => (
                (spec.min - self.given).min(0.0) / self.stddev,
                (spec.max - self.given).max(0.0) / self.stddev,
            ),
            _ => (f64::NEG_INFINITY, f64::INFINITY),
        };
        Parameter { stddev: 1.0, range }
    }
}

/// The nine mass properties, and what shows beside them: parameters of effects, and constants of the actuators that the
/// recordings used. Those that the prior knows exactly stay as given.
pub(crate) struct Parameters<'a> {
    model: &'a PlatformModel,
    mass: MassVector,
    pub prior_stddev: MassVector,
    pub free: Vec<Free>,
}

impl<'a> Parameters<'a> {
    pub fn new(model: &'a PlatformModel, prior: &ModelPrior, recordings: &[Recording]) -> Self {
        let (mass, prior_stddev) = (mass_vector(&model.mass_properties), prior_stddev(prior));
        let of_mass =
            |i: usize| Free { kind: Kind::Mass(i), of: None, given: mass[i], stddev: prior_stddev[i] };
        let mut free: Vec<Free> = (0..MASS_PARAMETERS).map(of_mass).collect();
        for effect in catalogue().iter().copied() {
            let given = model.effects.get(effect.info().id);
            let kind = match (given.is_some(), effect.is_base()) {
                // A correction of constants that was adopted stays: constants and it move together.
                (true, true) => continue,
                (true, false) => Kind::OfModel,
                (false, true) if shows(effect, recordings) => Kind::Actuator,
                (false, false) if effect.is_identified_with_mass() => Kind::Beside,
                (false, _) => continue,
            };
            for spec in effect.parameters(model).into_iter().filter(|spec| !spec.known) {
                let stddev = match kind {
                    Kind::Beside => spec.prior_stddev,
                    // These are among the nine.
                    _ if matches!(spec.base, Some(BasePrior::GravityOffset(_) | BasePrior::Inertia(..))) => {
                        0.0
                    }
                    _ if !is_used(spec.part, recordings) => 0.0,
                    _ => prior.of_parameter(model, effect, &spec),
                };
                let given = given.and_then(|given| given.get(&spec.name)).copied().unwrap_or(spec.neutral);
                free.push(Free { kind, of: Some((effect, spec)), given, stddev });
            }
        }
        free.retain(|free| free.stddev > 0.0 && free.stddev.is_finite());
        Self { model, mass, prior_stddev, free }
    }

    /// What is known of them before.
    pub fn known(&self) -> Vec<Parameter> {
        self.free.iter().map(Free::known).collect()
    }

    /// The nine at a place in units, whether a body can have them or not.
    pub fn mass_at(&self, units: &[f64]) -> MassVector {
        let mut mass = self.mass;
        for (free, units) in self.free.iter().zip(units) {
            if let Kind::Mass(i) = free.kind {
                mass[i] = free.value(*units);
            }
        }
        mass
    }

    /// The nearest of a body's: with the uncertainties from before as measure.
    pub fn body_at(&self, units: &[f64]) -> MassVector {
        let scale = self.prior_stddev.map(|s| if s > 0.0 { s * s } else { 1e-18 });
        nearest_realisable(&self.mass_at(units), &MassCovariance::from_diagonal(&scale))
    }

    /// The model with these values, in units; `None` where no platform is so. Inertias that no body has count as the nearest
    /// possible one.
    pub fn model_at(&self, units: &[f64]) -> Option<PlatformModel> {
        let model = self.with(units, |_| true)?;
        Gyrostat::new(&model).is_ok().then_some(model)
    }

    /// The model with these values as a platform's file has it: actuators corrected, the effects that it had before, and no others.
    pub fn written(&self, units: &[f64]) -> Option<PlatformModel> {
        let mut constants = self.with(units, |kind| kind == Kind::Actuator)?;
        constants.effects.retain(|id, _| !self.model.effects.contains_key(id));
        let mut model = Gyrostat::new(&constants).ok()?.model().clone();
        model.effects = self.with(units, |kind| kind == Kind::OfModel)?.effects;
        Some(model)
    }

    fn with(&self, units: &[f64], takes: impl Fn(Kind) -> bool) -> Option<PlatformModel> {
        let mut model = self.model.clone();
        model.mass_properties =
            mass_properties(&self.body_at(units), model.mass_properties.mass_kg()).ok()?;
        for (free, units) in self.free.iter().zip(units).filter(|(free, _)| takes(free.kind)) {
            if let Some((effect, spec)) = &free.of {
                let values = model.effects.entry(effect.info().id.to_owned()).or_default();
                values.insert(spec.name.clone(), free.value(*units));
            }
        }
        Some(model)
    }

    /// The prior with what is known of the written model: standard deviations of all parameters, in units.
    pub fn known_after(&self, prior: &ModelPrior, stddev: &DVector<f64>) -> ModelPrior {
        let mut prior = prior.clone();
        for (free, units) in self.free.iter().zip(stddev.iter()) {
            let stddev = units * free.stddev;
            match (free.kind, &free.of) {
                (Kind::Mass(i), _) if i < 6 => {
                    let (row, column) = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)][i];
                    BasePrior::Inertia(row, column).set_stddev(&mut prior, Part::Platform, stddev);
                }
                (Kind::Mass(i), _) => {
                    BasePrior::GravityOffset(i - 6).set_stddev(&mut prior, Part::Platform, stddev);
                }
                (Kind::Actuator, Some((_, spec))) => {
                    if let Some(base) = spec.base {
                        base.set_stddev(&mut prior, spec.part, stddev);
                    }
                }
                (Kind::OfModel, Some((effect, spec))) => {
                    let of_effect = prior.effects.entry(effect.info().id.to_owned()).or_default();
                    of_effect.insert(spec.name.clone(), stddev);
                }
                _ => {}
            }
        }
        prior
    }
}

/// Whether recordings can show a correction of the actuators' constants.
fn shows(effect: &dyn Effect, recordings: &[Recording]) -> bool {
    effect.evidence().iter().any(|needs| needs.iter().all(|need| has(*need, recordings)))
}

fn has(need: Need, recordings: &[Recording]) -> bool {
    let any = |test: fn(&Recording) -> bool| recordings.iter().any(test);
    match need {
        Need::Jets => any(|run| run.jet_pulses.iter().any(|pulses| !pulses.is_empty())),
        Need::Wheels => {
            any(|run| !run.wheel_speed_rad_s.is_empty() || !run.wheel_torque_command_n_m.is_empty())
        }
        Need::WheelCommands => any(|run| !run.wheel_torque_command_n_m.is_empty()),
        Need::Gimbals => any(|run| !run.gimbal_angle_rad.is_empty()),
        Need::VectorSensor => any(|run| !run.vectors.is_empty()),
        // Corrections of constants need none of the others that every run here has not.
        _ => true,
    }
}

/// Whether an actuator took part in a run.
fn is_used(part: Part, recordings: &[Recording]) -> bool {
    match part {
        Part::Jet(jet) => recordings.iter().any(|run| run.jet_pulses.get(jet).is_some_and(|p| !p.is_empty())),
        Part::Platform | Part::Wheel(_) | Part::Gyro(_) => true,
    }
}
