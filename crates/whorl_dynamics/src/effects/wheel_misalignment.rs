//! Spin axes that differ from the drawing.

use super::named::{Named as _, parameters, per_wheel};
use super::tilted::tilted;
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::platform::Wheel;

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

parameters! {
    /// Of one wheel.
    Tilt(_wheel: Wheel) {
        angles_rad: [f64; 2] = ["_a_rad", "_b_rad"].map(|name| {
            ParameterSpec::new(
                name,
                "rad",
                (-0.3, 0.3),
                0.01,
                "Tilt of the spin axis about e1 (a: across the axis and body z, or x for an axis along z) or e2 = a x e1 (b).",
            )
            .base(BasePrior::WheelAxis)
        }),
    }
}

impl Effect for WheelMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Tilt>(model)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, wheel) in model.wheels_mut().iter_mut().enumerate() {
            wheel.spin_axis_b = tilted(wheel.spin_axis_b, Tilt::nth(values, j).angles_rad);
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::FreeBody, Need::Wheels]]
    }
}
