//! Shear of the air film.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct BearingViscousFriction;

static INFO: EffectInfo = EffectInfo {
    id: "bearing_viscous_friction",
    title: "viscous friction of the bearing",
    explanation: "Shear of the air film brakes in proportion to the rate: spin decays exponentially, at the same relative rate at any speed.",
    equation: "g = -c w",
    source: "Newtonian shear of a thin film (Couette flow); air damping of Schwartz 2004, Table 3.1",
    kind: EffectKind::Torque,
    confusable_with: &["air_drag_quadratic", "bearing_coulomb_friction", "harness_spring"],
    separated_by: "coast down over at least 10:1 in rate, to a full stop",
    is_passive: true,
};

parameters! {
    Friction(_model: PlatformModel) {
        c_n_m_s: f64 = ParameterSpec::new("c_n_m_s", "N m s", (0.0, 5.0), 0.01, "Torque per body rate."),
    }
}

impl Effect for BearingViscousFriction {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Friction::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        -Friction::of(values).c_n_m_s * environment.omega_wb_b_rad_s
    }
}
