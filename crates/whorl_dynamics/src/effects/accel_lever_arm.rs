//! Accelerometer away from its place in the model.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct AccelLeverArm;

static INFO: EffectInfo = EffectInfo {
    id: "accel_lever_arm",
    title: "accelerometer position off",
    explanation: "The accelerometer is not where the model places it, so it measures different centripetal and tangential accelerations.",
    equation: "y += dw/dt x d + w x (w x d)",
    source: "Schwartz 2004, eq. 4.40 (rotation terms)",
    kind: EffectKind::Sensor,
    confusable_with: &["accel_bias", "imu_latency"],
    separated_by: "constant spin, then quick reversals",
    is_passive: false,
};

/// Beyond any platform [m]: where a sensor sits is no law of physics, and a position in the wrong unit is to be found too.
const FARTHEST_M: f64 = 10.0;

parameters! {
    Arm(_model: PlatformModel) {
        d_m: Vector3<f64> = per_axis("d", "_m", "m", FARTHEST_M, 0.02, "Added to the model's position, body axes."),
    }
}

impl Effect for AccelLeverArm {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Arm::specs(model)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        model.sensors.accelerometer.lever_arm_b_m += Arm::of(values).d_m;
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Accelerometer]]
    }
}
