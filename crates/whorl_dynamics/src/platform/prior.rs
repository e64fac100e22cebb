//! How well a platform is known before its data are fitted.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::PlatformModel;

/// Standard deviations of the parameters of a [`PlatformModel`] about their values, all >= 0; 0 means
/// known exactly. Every fit starts from these: none treats a nominal value as true.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPrior {
    /// Of each inertia matrix element, symmetric [kg m^2].
    pub inertia_b_kg_m2: Matrix3<f64>,
    /// Of the gravity offset m g r_cg [N m].
    pub gravity_offset_b_n_m: Vector3<f64>,
    /// Of each wheel's spin inertia, as a share of its value.
    pub wheel_spin_inertia: Vec<f64>,
    /// Of each wheel's spin axis, about each of two axes across it \[rad\].
    pub wheel_axis_rad: Vec<f64>,
    /// Of each jet's thrust, as a share of its value.
    pub jet_thrust: Vec<f64>,
    /// Of each jet's torque direction, about each of two axes across it \[rad\].
    pub jet_direction_rad: Vec<f64>,
    /// Of the parameters of effects that the model has: effect id -> parameter -> standard deviation.
    pub effects: BTreeMap<String, BTreeMap<String, f64>>,
}

impl ModelPrior {
    /// What a careful builder knows from drawings and bench tests: inertia to 5 % of the mean of the two
    /// principal axes concerned, gravity offset to 20 % (at least 0.02 N m), wheel inertia to 1 %, jets to
    /// 5 %, wheel axes to 2 mrad, jet directions to 10 mrad.
    #[must_use]
    pub fn typical(model: &PlatformModel) -> Self {
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let offset = model.mass_properties.gravity_offset_b_n_m();
        let (wheels, jets) = (model.wheels.len(), model.jets.len());
        Self {
            inertia_b_kg_m2: Matrix3::from_fn(|i, j| 0.05 * 0.5 * (inertia[(i, i)] + inertia[(j, j)])),
            gravity_offset_b_n_m: offset.map(|x| (0.2 * x.abs()).max(0.02)),
            wheel_spin_inertia: vec![0.01; wheels],
            wheel_axis_rad: vec![2.0e-3; wheels],
            jet_thrust: vec![0.05; jets],
            jet_direction_rad: vec![1.0e-2; jets],
            effects: BTreeMap::new(),
        }
    }
}
