//! Wheels heavier or lighter than on the drawing.

use super::named::{Named as _, parameters, per_wheel};
use super::{Aid, BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::platform::Wheel;

#[derive(Debug)]
pub(super) struct WheelInertia;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_inertia",
    title: "wheel spin inertia off by a factor",
    explanation: "A wheel holds more or less momentum at the same speed; the platform's total inertia, wheels at rest, is unchanged.",
    equation: "J_j = J_model_j (1 + e_j)",
    source: "definition; I_s in Schwartz 2004, eqs. 4.9-4.12",
    kind: EffectKind::Actuator,
    confusable_with: &["wheel_misalignment", "gyro_scale", "wheel_friction"],
    separated_by: "wheel sweep at zero body rate, then at constant yaw rate",
    is_passive: false,
};

parameters! {
    /// Of one wheel.
    Inertia(_wheel: Wheel) {
        error: f64 = ParameterSpec::new("", "1", (-0.5, 0.5), 0.02, "Relative error of this wheel.")
            .base(BasePrior::WheelSpinInertia),
    }
}

impl Effect for WheelInertia {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Inertia>(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, wheel) in model.wheels_mut().iter_mut().enumerate() {
            wheel.spin_inertia_kg_m2 *= 1.0 + Inertia::nth(values, j).error;
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Wheels]]
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::WheelSpeed]
    }
}
