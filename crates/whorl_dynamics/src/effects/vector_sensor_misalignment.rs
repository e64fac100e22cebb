//! Misaligned vector sensor.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct VectorSensorMisalignment;

static INFO: EffectInfo = EffectInfo {
    id: "vector_sensor_misalignment",
    title: "vector sensor mounted askew",
    explanation: "The vector sensor's axes are turned against the body's: a constant rotation between its attitude and the accelerometer's.",
    equation: "y = exp([m]x)^T v_b",
    source: "definition",
    kind: EffectKind::Sensor,
    confusable_with: &["accel_bias"],
    separated_by: "rest at several azimuths",
    is_passive: false,
};

parameters! {
    Turn(_model: PlatformModel) {
        m_rad: Vector3<f64> = per_axis("m", "_rad", "rad", 0.3, 0.01, "Rotation from body to sensor axes, added to the model's."),
    }
}

impl Effect for VectorSensorMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Turn::specs(model)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        if let Some(sensor) = &mut model.sensors.vector {
            sensor.misalignment_rad += Turn::of(values).m_rad;
        }
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::VectorSensor]]
    }
}
