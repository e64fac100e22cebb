//! Scale factor error of the accelerometer.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct AccelScale;

static INFO: EffectInfo = EffectInfo {
    id: "accel_scale",
    title: "accelerometer scale factor",
    explanation: "The accelerometer reads too much or too little in proportion: a tilt error that grows with tilt.",
    equation: "y_i = (1 + s_i) f_i",
    source: "Schwartz 2004, section 4.4 (response slopes agree with the specification within 2 %)",
    kind: EffectKind::Sensor,
    confusable_with: &["accel_bias"],
    separated_by: "rest at several tilts",
    is_passive: false,
};

parameters! {
    Scale(_model: PlatformModel) {
        scale: Vector3<f64> = per_axis("scale", "", "1", 0.3, 0.01, "Added to the model's scale factor error."),
    }
}

impl Effect for AccelScale {
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
        model.sensors.accelerometer.errors.scale += Scale::of(values).scale;
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Accelerometer]]
    }
}
