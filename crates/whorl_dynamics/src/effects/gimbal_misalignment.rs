//! Gimbal axes that differ from the drawing.

use super::named::{Named as _, parameters, per_gyro};
use super::tilted::tilt;
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::actuators::control_moment_gyros::Gyro;

#[derive(Debug)]
pub(super) struct GimbalMisalignment;

static INFO: EffectInfo = EffectInfo {
    id: "gimbal_misalignment",
    title: "gimbal axis of a control moment gyro tilted",
    explanation: "A gyro's gimbal axis is tilted: its rotor's momentum sweeps another plane, so that turning the gimbal also turns the platform about another axis.",
    equation: "g_j and s_j turned by the rotation vector alpha e1 + beta e2 across g_j",
    source: "definition; g and s in Wie, Space Vehicle Dynamics and Control, AIAA 1998, section 7.5",
    kind: EffectKind::Actuator,
    confusable_with: &["rotor_momentum", "inertia_products"],
    separated_by: "turning each gimbal alone through a large angle",
    is_passive: false,
};

parameters! {
    /// Of one gyro.
    Tilt(_gyro: Gyro) {
        angles_rad: [f64; 2] = ["_a_rad", "_b_rad"].map(|name| {
            ParameterSpec::new(
                name,
                "rad",
                (-0.3, 0.3),
                0.01,
                "Tilt of the gimbal axis about e1 (a: across the axis and body z, or x for an axis along z) or e2 = g x e1 (b).",
            )
            .base(BasePrior::GimbalAxis)
        }),
    }
}

impl Effect for GimbalMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_gyro::<Tilt>(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, gyro) in model.gyros_mut().iter_mut().enumerate() {
            let angles_rad = Tilt::nth(values, j).angles_rad;
            if angles_rad == [0.0; 2] {
                continue;
            }
            // The rotor is carried by the gimbal: it turns with the axis.
            let turn = tilt(gyro.gimbal_axis_b, angles_rad);
            (gyro.gimbal_axis_b, gyro.spin_axis_b) = (turn * gyro.gimbal_axis_b, turn * gyro.spin_axis_b);
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
