//! Constant offset of the gyro.

use super::parameter::{per_axis, vector};
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct GyroBias;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_bias",
    title: "gyro bias",
    explanation: "The gyro reads a constant rate at rest; every base model has it, the parameters are what is to be added to the model's.",
    equation: "y = w + b",
    source: "Schwartz 2004, section 4.5.4",
    kind: EffectKind::Sensor,
    confusable_with: &["earth_rotation", "gyro_temperature"],
    separated_by: "rest at several headings and temperatures",
    is_passive: false,
};

impl Effect for GyroBias {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        per_axis("bias", "_rad_s", "rad/s", 0.2, 0.01, "Added to the model's bias.")
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        model.sensors.gyro.errors.bias += vector(values, 0);
        Ok(())
    }
}
