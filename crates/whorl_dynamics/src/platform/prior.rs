//! The prior of a platform, before its data are fitted.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::PlatformModel;
use crate::actuators::ActuatorPriors;

/// Standard deviations of the parameters of a [`PlatformModel`] about their values, all >= 0; 0 means
/// known exactly. Every fit starts from these: none treats a nominal value as true.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPrior {
    /// Of each inertia matrix element, symmetric [kg m^2].
    pub inertia_b_kg_m2: Matrix3<f64>,
    /// Of the gravity offset m g r_cg [N m].
    pub gravity_offset_b_n_m: Vector3<f64>,
    /// Of the actuators, by kind.
    pub actuators: ActuatorPriors,
    /// Of the parameters of effects that the model has: effect id -> parameter -> standard deviation.
    pub effects: BTreeMap<String, BTreeMap<String, f64>>,
}

impl ModelPrior {
    /// Typical prior from drawings and bench tests: inertia to 5 % of the mean of the two
    /// principal axes concerned, gravity offset to 20 % (at least 0.02 N m), actuators as their kinds say.
    #[must_use]
    pub fn typical(model: &PlatformModel) -> Self {
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let offset = model.mass_properties.gravity_offset_b_n_m();
        Self {
            inertia_b_kg_m2: Matrix3::from_fn(|i, j| 0.05 * 0.5 * (inertia[(i, i)] + inertia[(j, j)])),
            gravity_offset_b_n_m: offset.map(|x| (0.2 * x.abs()).max(0.02)),
            actuators: model.actuators.typical_priors(),
            effects: BTreeMap::new(),
        }
    }
}
