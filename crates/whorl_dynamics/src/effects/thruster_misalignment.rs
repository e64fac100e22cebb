//! Jets that do not point as on the drawing.

use super::named::{Named as _, parameters, per_jet};
use super::tilted::tilted;
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::platform::Jet;

#[derive(Debug)]
pub(super) struct ThrusterMisalignment;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_misalignment",
    title: "jet direction off",
    explanation: "A nozzle points a little aside, so its pulses also turn the platform about another axis.",
    equation: "f_j tilted by angles a, b about two axes across it: f_j cos(n) + (a e1 + b e2) x f_j sin(n)/n, n = |(a, b)|",
    source: "definition (rotation vector across the nozzle axis, Rodrigues' formula)",
    kind: EffectKind::Actuator,
    confusable_with: &["gravity_offset", "inertia_products"],
    separated_by: "one jet alone, at rest and level",
    is_passive: false,
};

parameters! {
    /// Of one jet.
    Tilt(_jet: Jet) {
        angles_rad: [f64; 2] = ["_a_rad", "_b_rad"].map(|name| {
            ParameterSpec::new(
                name,
                "rad",
                (-0.5, 0.5),
                0.03,
                "Tilt of the force about e1 (a: across the force and body z, or x for a jet along z) or e2 = f x e1 (b).",
            )
            .base(BasePrior::JetDirection)
        }),
    }
}

impl Effect for ThrusterMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_jet::<Tilt>(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, jet) in model.jets_mut().iter_mut().enumerate() {
            jet.force_direction_b = tilted(jet.force_direction_b, Tilt::nth(values, j).angles_rad);
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets]]
    }
}
