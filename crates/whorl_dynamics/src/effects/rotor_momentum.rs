//! Rotors of control moment gyros faster or slower, heavier or lighter than they should be.

use super::named::{Named as _, parameters, per_gyro};
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::actuators::control_moment_gyros::Gyro;

#[derive(Debug)]
pub(super) struct RotorMomentum;

static INFO: EffectInfo = EffectInfo {
    id: "rotor_momentum",
    title: "rotor momentum of a control moment gyro off by a factor",
    explanation: "A gyro's rotor holds more or less momentum than stated: turning its gimbal turns the platform more or less, about the right axis.",
    equation: "h_j = h_model_j (1 + e_j)",
    source: "definition; h_0 in Wie, Space Vehicle Dynamics and Control, AIAA 1998, section 7.5",
    kind: EffectKind::Actuator,
    confusable_with: &["gimbal_misalignment", "gyro_scale"],
    separated_by: "turning each gimbal alone through a large angle",
    is_passive: false,
};

parameters! {
    /// Of one gyro.
    Momentum(_gyro: Gyro) {
        error: f64 = ParameterSpec::new("", "1", (-0.9, 0.9), 0.02, "Relative error of this rotor's momentum.")
            .base(BasePrior::RotorMomentum),
    }
}

impl Effect for RotorMomentum {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_gyro::<Momentum>(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, gyro) in model.gyros_mut().iter_mut().enumerate() {
            gyro.rotor_momentum_n_m_s *= 1.0 + Momentum::nth(values, j).error;
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Gimbals]]
    }
}
