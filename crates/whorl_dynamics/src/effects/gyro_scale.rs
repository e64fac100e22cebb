//! Scale factor error of the gyro.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct GyroScale;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_scale",
    title: "gyro scale factor",
    explanation: "The gyro reads too much or too little in proportion to the rate: a kinematic residual that no torque can cause.",
    equation: "y_i = (1 + s_i) w_i",
    source: "Schwartz 2004, section 4.4 (response slopes agree with the specification within 5 %)",
    kind: EffectKind::Sensor,
    confusable_with: &["wheel_inertia"],
    separated_by: "turn through a known angle about each axis",
    is_passive: false,
};

parameters! {
    Scale(_model: PlatformModel) {
        scale: Vector3<f64> = per_axis("scale", "", "1", 0.3, 0.02, "Added to the model's scale factor error."),
    }
}

impl Effect for GyroScale {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Scale::specs(model)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        model.sensors.gyro.errors.scale += Scale::of(values).scale;
        Ok(())
    }
}
