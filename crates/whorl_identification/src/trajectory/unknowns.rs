//! What a fit looks for, and how well it is known before.

use nalgebra::{DVector, Unit, Vector3};
use whorl_dynamics::{ModelPrior, PlatformModel};

use whorl_math::unit_or;

use crate::mass_parameters::{MASS_PARAMETERS, mass_vector, prior_stddev};

/// Position of the bearing's viscous friction among the unknowns.
pub(crate) const FRICTION: usize = MASS_PARAMETERS;
/// Where actuators begin.
pub(crate) const ACTUATORS: usize = MASS_PARAMETERS + 1;
/// Unknowns of one wheel or jet: strength, and turns of its axis about two axes across it.
const PER_ACTUATOR: usize = 3;
/// Standard deviation of the bearing's viscous friction before a fit [N m s].
const FRICTION_STDDEV_N_M_S: f64 = 0.01;
/// What counts as known exactly still has this share of freedom, to keep matrices regular.
const EXACT: f64 = 1e-9;

/// The unknowns that all runs share: mass properties, bearing friction, wheels, jets that fired.
#[derive(Debug, Clone)]
pub(crate) struct Unknowns {
    /// Mean before the fit.
    pub mean: DVector<f64>,
    /// Standard deviation before the fit, > 0.
    pub stddev: DVector<f64>,
    /// Number of wheels.
    pub wheels: usize,
    /// Jets that fired, by index.
    pub jets: Vec<usize>,
}

impl Unknowns {
    pub fn new(model: &PlatformModel, prior: &ModelPrior, jets: Vec<usize>) -> Self {
        let wheels = model.wheels().len();
        let count = ACTUATORS + PER_ACTUATOR * (wheels + jets.len());
        let mut mean = DVector::zeros(count);
        let mut stddev = DVector::repeat(count, EXACT);
        mean.rows_mut(0, MASS_PARAMETERS).copy_from(&mass_vector(&model.mass_properties));
        stddev.rows_mut(0, MASS_PARAMETERS).copy_from(&prior_stddev(prior).map(|s| s.max(EXACT)));
        mean[FRICTION] = effect(&model.effects, "bearing_viscous_friction", "c_n_m_s").unwrap_or(0.0);
        stddev[FRICTION] = effect(&prior.effects, "bearing_viscous_friction", "c_n_m_s")
            .filter(|s| *s > 0.0)
            .unwrap_or(FRICTION_STDDEV_N_M_S);
        let known = |list: &[f64], j: usize| list.get(j).copied().unwrap_or(0.0).max(EXACT);
        for j in 0..wheels {
            let at = ACTUATORS + PER_ACTUATOR * j;
            stddev[at] = known(&prior.actuators.wheels.spin_inertia, j);
            stddev.rows_mut(at + 1, 2).fill(known(&prior.actuators.wheels.axis_rad, j));
        }
        for (n, j) in jets.iter().enumerate() {
            let at = ACTUATORS + PER_ACTUATOR * (wheels + n);
            stddev[at] = known(&prior.actuators.jets.thrust, *j);
            stddev.rows_mut(at + 1, 2).fill(known(&prior.actuators.jets.direction_rad, *j));
        }
        Self { mean, stddev, wheels, jets }
    }

    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// Strength and axis turns of a wheel.
    pub fn wheel(&self, values: &DVector<f64>, wheel: usize) -> [f64; PER_ACTUATOR] {
        triple(values, ACTUATORS + PER_ACTUATOR * wheel)
    }

    /// Where the strength of a wheel is.
    pub fn wheel_strength(&self, wheel: usize) -> usize {
        ACTUATORS + PER_ACTUATOR * wheel
    }

    /// Strength and axis turns of the n-th jet that fired.
    pub fn jet(&self, values: &DVector<f64>, n: usize) -> [f64; PER_ACTUATOR] {
        triple(values, ACTUATORS + PER_ACTUATOR * (self.wheels + n))
    }

    /// Where the strength of the n-th jet that fired is.
    pub fn jet_strength(&self, n: usize) -> usize {
        ACTUATORS + PER_ACTUATOR * (self.wheels + n)
    }
}

fn triple(values: &DVector<f64>, at: usize) -> [f64; PER_ACTUATOR] {
    [values[at], values[at + 1], values[at + 2]]
}

fn effect(
    effects: &std::collections::BTreeMap<String, std::collections::BTreeMap<String, f64>>,
    id: &str,
    parameter: &str,
) -> Option<f64> {
    effects.get(id)?.get(parameter).copied()
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
