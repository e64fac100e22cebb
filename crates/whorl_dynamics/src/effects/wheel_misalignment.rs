//! Spin axes that are not where the drawing says.

use super::parameter::value;
use super::tilted::tilted;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct WheelMisalignment;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_misalignment",
    title: "wheel spin axis tilted",
    explanation: "A wheel's axis is tilted: accelerating it also turns the platform about other axes, and its momentum couples with the body rate.",
    equation: "a_j turned by the rotation vector alpha e1 + beta e2 across it",
    source: "definition; A in Schwartz 2004, eqs. 4.9-4.13",
    kind: EffectKind::Actuator,
    confusable_with: &["wheel_inertia", "inertia_products"],
    separated_by: "wheel sweep at zero body rate, then at constant yaw rate",
    is_passive: false,
};

impl Effect for WheelMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        model
            .wheels()
            .iter()
            .enumerate()
            .flat_map(|(j, wheel)| {
                ["a", "b"].map(|angle| {
                    ParameterSpec::new(
                        format!("{}_{angle}_rad", wheel.name),
                        "rad",
                        (-0.3, 0.3),
                        0.01,
                        "Tilt of the spin axis about e1 (a: across the axis and body z, or x for an axis along z) or e2 = a x e1 (b).",
                    ).of_wheel(j)
                })
            })
            .collect()
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, wheel) in model.wheels_mut().iter_mut().enumerate() {
            wheel.spin_axis_b = tilted(wheel.spin_axis_b, value(values, 2 * j), value(values, 2 * j + 1));
        }
        Ok(())
    }
}
