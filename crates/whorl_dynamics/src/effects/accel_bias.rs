//! Constant offset of the accelerometer.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct AccelBias;

static INFO: EffectInfo = EffectInfo {
    id: "accel_bias",
    title: "accelerometer bias",
    explanation: "The accelerometer reads a constant offset: a static error of tilt.",
    equation: "y = f + b",
    source: "Schwartz 2004, section 4.4 (offsets from six static orientations)",
    kind: EffectKind::Sensor,
    confusable_with: &["vector_sensor_misalignment", "gravity_offset"],
    separated_by: "rest at several tilts and azimuths",
    is_passive: false,
};

parameters! {
    Bias(_model: PlatformModel) {
        bias_m_s2: Vector3<f64> = per_axis("bias", "_m_s2", "m/s^2", 2.0, 0.05, "Added to the model's bias."),
    }
}

impl Effect for AccelBias {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Bias::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        model.sensors.accelerometer.errors.bias += Bias::of(values).bias_m_s2;
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Accelerometer]]
    }
}
