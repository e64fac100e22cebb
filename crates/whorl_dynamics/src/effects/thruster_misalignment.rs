//! Jets that do not point where the drawing says.

use super::parameter::value;
use super::tilted::tilted;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

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

impl Effect for ThrusterMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        model
            .jets()
            .iter()
            .enumerate()
            .flat_map(|(j, jet)| {
                ["a", "b"].map(|angle| {
                    ParameterSpec::new(
                        format!("{}_{angle}_rad", jet.name),
                        "rad",
                        (-0.5, 0.5),
                        0.03,
                        "Tilt of the force about e1 (a: across the force and body z, or x for a jet along z) or e2 = f x e1 (b).",
                    ).of_jet(j)
                })
            })
            .collect()
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, jet) in model.jets_mut().iter_mut().enumerate() {
            jet.force_direction_b = tilted(jet.force_direction_b, value(values, 2 * j), value(values, 2 * j + 1));
        }
        Ok(())
    }
}
