//! Constant offset of the gyro.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct GyroBias;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_bias",
    title: "gyro bias",
    explanation: "The gyro reads a constant rate at rest; every base model has it, the parameters are corrections of the model's bias.",
    equation: "y = w + b",
    source: "Schwartz 2004, section 4.5.4",
    kind: EffectKind::Sensor,
    confusable_with: &["earth_rotation", "gyro_temperature"],
    separated_by: "rest at several headings and temperatures",
    is_passive: false,
};

parameters! {
    Bias(_model: PlatformModel) {
        bias_rad_s: Vector3<f64> = per_axis("bias", "_rad_s", "rad/s", 0.2, 0.01, "Added to the model's bias."),
    }
}

impl Effect for GyroBias {
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
        model.sensors.gyro.errors.bias += Bias::of(values).bias_rad_s;
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        // Every base model has it, per run.
        &[]
    }
}
