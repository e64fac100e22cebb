//! Gravity that falls with height.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, Evidence, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct GravityGradient;

/// mu / R^3 at the Earth's surface [1/s^2].
const MU_OVER_R3_S2: f64 = 3.986_004e14 / (6.371e6 * 6.371e6 * 6.371e6);

static INFO: EffectInfo = EffectInfo {
    id: "gravity_gradient",
    title: "gravity gradient",
    explanation: "The lower side is pulled a little harder: a few micronewton metres, negligible in this laboratory, and included to show that.",
    equation: "g = 3 mu/R^3 k_b x (I k_b)",
    source: "Hughes, Spacecraft Attitude Dynamics, 1986, section 8.1; gravity gradient of Schwartz 2004, Table 3.1",
    kind: EffectKind::Torque,
    confusable_with: &["gravity_offset", "anisoelastic_sag"],
    separated_by: "",
    is_passive: false,
};

parameters! {
    Gradient(_model: PlatformModel) {
        scale: f64 = ParameterSpec::new("scale", "1", (0.0, 1.0), 1.0, "1 = present, 0 = absent."),
    }
}

impl Effect for GravityGradient {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Gradient::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let k_b = environment.vertical_b;
        let inertia = environment.model.mass_properties.inertia_b_kg_m2();
        3.0 * MU_OVER_R3_S2 * Gradient::of(values).scale * k_b.cross(&(inertia * k_b))
    }

    fn evidence(&self) -> Evidence {
        // Negligible here.
        &[]
    }
}
