//! A deck that bends under its own weight.

use nalgebra::{Matrix3, Vector3};

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct AnisoelasticSag;

static INFO: EffectInfo = EffectInfo {
    id: "anisoelastic_sag",
    title: "deck that bends under its weight",
    explanation: "The centre of mass moves as the deck bends with tilt, so the pendulum's stiffness depends on direction and amplitude; an equal compliance in all directions has no effect.",
    equation: "r = -C m g k_b, g = -(m g r) x k_b = (m g)^2 (C k_b) x k_b, C symmetric",
    source: "anisoelasticity of Schwartz 2004, Table 3.1",
    kind: EffectKind::Torque,
    confusable_with: &["gravity_offset"],
    separated_by: "large tilts to several azimuths",
    is_passive: false,
};

parameters! {
    Compliance(_model: PlatformModel) {
        elements_m_n: [f64; 6] = ["cxx_m_n", "cyy_m_n", "czz_m_n", "cxy_m_n", "cxz_m_n", "cyz_m_n"].map(|name| {
            ParameterSpec::new(
                name,
                "m/N",
                (-1e-4, 1e-4),
                3e-7,
                "Element of the compliance: movement of the centre of mass per force, body axes.",
            )
        }),
    }
}

impl Effect for AnisoelasticSag {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Compliance::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let [xx, yy, zz, xy, xz, yz] = Compliance::of(values).elements_m_n;
        let compliance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let weight_b_n = environment.model.mass_properties.mass_kg() * environment.specific_force_b_m_s2();
        (compliance * weight_b_n).cross(&weight_b_n)
    }
}
