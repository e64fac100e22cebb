//! Constant offset of the accelerometer.

use super::parameter::{per_axis, vector};
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
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

impl Effect for AccelBias {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        per_axis("bias", "_m_s2", "m/s^2", 2.0, 0.05, "Added to the model's bias.")
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        model.sensors.accelerometer.errors.bias += vector(values, 0);
        Ok(())
    }
}
