//! The prior of a platform, before its data are fitted.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use whorl_math::GRAVITY_M_S2;

use super::PlatformModel;
use crate::actuators::ActuatorPriors;

/// How well a balanced platform's centre of mass is known, over its radius of gyration: 0.02 N m, a few grams half a metre
/// out, for a platform of 100 kg and 9 kg m^2, and as much of its size for any other.
const CENTRE_OF_MASS_SHARE: f64 = 7e-5;

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
    /// principal axes concerned, gravity offset to 20 % (at least a centre of mass within 7e-5 of the
    /// radius of gyration), actuators as their kinds say. What has no part in the motion that the rig leaves is exact:
    /// the offset without weight, both of a clamped body.
    #[must_use]
    pub fn typical(model: &PlatformModel) -> Self {
        let mass = &model.mass_properties;
        let (inertia, offset) = (mass.inertia_b_kg_m2(), mass.gravity_offset_b_n_m());
        // m g r with r a share of sqrt(tr I / (3 m)).
        let least = CENTRE_OF_MASS_SHARE * GRAVITY_M_S2 * (mass.mass_kg() * inertia.trace() / 3.0).sqrt();
        let weighs = model.freedom.turns() && model.freedom.has_weight();
        Self {
            inertia_b_kg_m2: if model.freedom.turns() {
                Matrix3::from_fn(|i, j| 0.05 * 0.5 * (inertia[(i, i)] + inertia[(j, j)]))
            } else {
                Matrix3::zeros()
            },
            gravity_offset_b_n_m: if weighs {
                offset.map(|x| (0.2 * x.abs()).max(least))
            } else {
                Vector3::zeros()
            },
            actuators: model.actuators.typical_priors(),
            effects: BTreeMap::new(),
        }
    }

    /// The same prior with the standard deviations of the mass properties multiplied by `factor` (> 0).
    #[must_use]
    pub fn with_mass_properties_scaled(mut self, factor: f64) -> Self {
        self.inertia_b_kg_m2 *= factor;
        self.gravity_offset_b_n_m *= factor;
        self
    }
}
