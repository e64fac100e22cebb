//! The unknowns of a fit, and their prior.

use std::sync::Arc;

use nalgebra::{DVector, Unit, Vector3};
use whorl_dynamics::effects::catalogue;
use whorl_dynamics::{Effect, EffectSet, ModelPrior, ParameterSpec, PlatformModel};

use whorl_math::unit_or;

use crate::mass_parameters::{MASS_PARAMETERS, mass_vector, prior_stddev};

/// Where parameters of effects begin.
pub(crate) const EFFECTS: usize = MASS_PARAMETERS;
/// Unknowns of one wheel or jet: strength, and turns of its axis about two axes across it.
const PER_ACTUATOR: usize = 3;
/// Quantities known exactly still get this share as uncertainty, to keep matrices regular.
const EXACT: f64 = 1e-9;
/// Differences for derivatives, small against every quantity's uncertainty: of mass properties and actuators, ...
const DIFFERENCE: f64 = 1e-6;
/// ... and of effects, whose units are many, over the uncertainty.
const DIFFERENCE_OF_EFFECTS: f64 = 1e-4;

/// An effect in the equations of a fit.
#[derive(Debug, Clone)]
pub(crate) struct Carried {
    pub effect: &'static dyn Effect,
    /// Its parameters as the model has them.
    values: Vec<f64>,
    /// Positions of those that the fit may move.
    free: Vec<usize>,
}

/// The unknowns that all runs share: mass properties, parameters of effects, wheels, jets that fired.
#[derive(Debug, Clone)]
pub(crate) struct Unknowns {
    /// Mean before the fit.
    pub mean: DVector<f64>,
    /// Standard deviation before the fit, > 0.
    pub stddev: DVector<f64>,
    /// Effects of the model, and those that every identification includes.
    pub effects: Vec<Carried>,
    /// Effects of the model that are left out because they have states of their own.
    pub left_out: Vec<&'static str>,
    /// The model.
    pub model: Arc<PlatformModel>,
    /// Where actuators begin.
    pub actuators: usize,
    /// Number of wheels.
    pub wheels: usize,
    /// Jets that fired, by index.
    pub jets: Vec<usize>,
}

impl Unknowns {
    pub fn new(model: &PlatformModel, prior: &ModelPrior, jets: Vec<usize>) -> Self {
        let is_adopted = |effect: &dyn Effect| model.effects.contains_key(effect.info().id);
        let (carried, left_out): (Vec<_>, Vec<_>) = catalogue()
            .iter()
            .copied()
            .filter(|effect| is_adopted(*effect) || effect.is_identified_with_mass())
            .partition(|effect| effect.hidden_states(model) == 0);
        let (mut effects, mut of_effects) = (Vec::new(), Vec::new());
        for effect in carried {
            let specs = effect.parameters(model);
            let given = model.effects.get(effect.info().id);
            let value = |s: &ParameterSpec| given.and_then(|g| g.get(&s.name)).copied().unwrap_or(s.neutral);
            let values: Vec<f64> = specs.iter().map(value).collect();
            let mut free = Vec::new();
            for (at, spec) in specs.iter().enumerate() {
                let stddev = match is_adopted(effect) {
                    // Corrections of the platform's own parameters move with these.
                    true if effect.is_base() => 0.0,
                    true => prior.of_parameter(model, effect, spec),
                    false => spec.prior_stddev,
                };
                if !spec.known && stddev > 0.0 {
                    free.push(at);
                    of_effects.push((values.get(at).copied().unwrap_or(spec.neutral), stddev));
                }
            }
            effects.push(Carried { effect, values, free });
        }
        let wheels = model.wheels().len();
        let actuators = EFFECTS + of_effects.len();
        let count = actuators + PER_ACTUATOR * (wheels + jets.len());
        let mut mean = DVector::zeros(count);
        let mut stddev = DVector::repeat(count, EXACT);
        mean.rows_mut(0, MASS_PARAMETERS).copy_from(&mass_vector(&model.mass_properties));
        stddev.rows_mut(0, MASS_PARAMETERS).copy_from(&prior_stddev(prior).map(|s| s.max(EXACT)));
        for (n, (value, of_value)) in of_effects.into_iter().enumerate() {
            (mean[EFFECTS + n], stddev[EFFECTS + n]) = (value, of_value);
        }
        let known = |list: &[f64], j: usize| list.get(j).copied().unwrap_or(0.0).max(EXACT);
        for j in 0..wheels {
            let at = actuators + PER_ACTUATOR * j;
            stddev[at] = known(&prior.actuators.wheels.spin_inertia, j);
            stddev.rows_mut(at + 1, 2).fill(known(&prior.actuators.wheels.axis_rad, j));
        }
        for (n, j) in jets.iter().enumerate() {
            let at = actuators + PER_ACTUATOR * (wheels + n);
            stddev[at] = known(&prior.actuators.jets.thrust, *j);
            stddev.rows_mut(at + 1, 2).fill(known(&prior.actuators.jets.direction_rad, *j));
        }
        let left_out = left_out.iter().map(|effect| effect.info().id).collect();
        Self { mean, stddev, effects, left_out, model: Arc::new(model.clone()), actuators, wheels, jets }
    }

    /// The effects at these values of the unknowns.
    pub fn effect_set(&self, values: &DVector<f64>) -> EffectSet {
        let mut of_effects = values.iter().skip(EFFECTS);
        let at = |carried: &Carried| {
            let mut own = carried.values.clone();
            for at in &carried.free {
                if let (Some(slot), Some(value)) = (own.get_mut(*at), of_effects.next()) {
                    *slot = *value;
                }
            }
            (carried.effect, own)
        };
        EffectSet::with_values(self.effects.iter().map(at).collect::<Vec<_>>(), &self.model)
    }

    /// Each unknown parameter of an effect: the effect, the parameter, its position among the unknowns.
    pub fn of_effects(&self) -> Vec<(&'static dyn Effect, ParameterSpec, usize)> {
        let mut found = Vec::new();
        for carried in &self.effects {
            let specs = carried.effect.parameters(&self.model);
            for spec in carried.free.iter().filter_map(|i| specs.get(*i)) {
                found.push((carried.effect, spec.clone(), EFFECTS + found.len()));
            }
        }
        found
    }

    /// Difference for the derivative by an unknown.
    pub fn difference(&self, unknown: usize) -> f64 {
        if (EFFECTS..self.actuators).contains(&unknown) {
            DIFFERENCE_OF_EFFECTS * self.stddev[unknown]
        } else {
            DIFFERENCE
        }
    }

    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// Strength and axis turns of a wheel.
    pub fn wheel(&self, values: &DVector<f64>, wheel: usize) -> [f64; PER_ACTUATOR] {
        triple(values, self.actuators + PER_ACTUATOR * wheel)
    }

    /// Where the strength of a wheel is.
    pub fn wheel_strength(&self, wheel: usize) -> usize {
        self.actuators + PER_ACTUATOR * wheel
    }

    /// Strength and axis turns of the n-th jet that fired.
    pub fn jet(&self, values: &DVector<f64>, n: usize) -> [f64; PER_ACTUATOR] {
        triple(values, self.actuators + PER_ACTUATOR * (self.wheels + n))
    }

    /// Where the strength of the n-th jet that fired is.
    pub fn jet_strength(&self, n: usize) -> usize {
        self.actuators + PER_ACTUATOR * (self.wheels + n)
    }
}

fn triple(values: &DVector<f64>, at: usize) -> [f64; PER_ACTUATOR] {
    [values[at], values[at + 1], values[at + 2]]
}

/// `vector` made stronger by `turns[0]` (a share) and turned by `turns[1..]` about two axes across it.
pub(crate) fn adjusted(vector: &Vector3<f64>, turns: [f64; PER_ACTUATOR]) -> Vector3<f64> {
    let Some(direction) = Unit::try_new(*vector, 1e-12) else { return *vector };
    // The axis of the body least along the vector gives the first axis across.
    let least = vector.iamin();
    let mut helper = Vector3::zeros();
    helper[least] = 1.0;
    // The helper is across the vector, so the fallback is never taken.
    let first = unit_or(direction.cross(&helper), Vector3::x_axis()).into_inner();
    let second = direction.cross(&first);
    vector * (1.0 + turns[0]) + (first * turns[1] + second * turns[2]).cross(vector)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_actuator_is_scaled_and_turned_across_its_axis() {
        let v = Vector3::new(0.0, 0.3, 0.0);
        let scaled = adjusted(&v, [0.1, 0.0, 0.0]);
        assert!((scaled - Vector3::new(0.0, 0.33, 0.0)).norm() < 1e-15);
        let turned = adjusted(&v, [0.0, 2e-3, -1e-3]);
        assert!(turned.y == 0.3 && (turned - v).norm() > 6e-4);
        assert!((turned - v).norm() < 0.3 * 2.3e-3);
    }
}
