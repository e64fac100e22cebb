//! Inertial data older than their stamp.

use super::named::{Named as _, parameters};
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ImuLatency;

static INFO: EffectInfo = EffectInfo {
    id: "imu_latency",
    title: "inertial data late",
    explanation: "Gyro and accelerometer data are older than their stamp: the same lag in every channel, not tied to one actuator.",
    equation: "y(t) = true(t - t_model - t_late)",
    source: "definition",
    kind: EffectKind::Sensor,
    confusable_with: &["thruster_delay", "thruster_rise", "imu_bandwidth"],
    separated_by: "wheels and jets in turn: latency delays the response to both",
    is_passive: false,
};

parameters! {
    Latency(_model: PlatformModel) {
        t_s: f64 = ParameterSpec::new("t_s", "s", (0.0, 0.5), 0.01, "Added to the model's latency."),
    }
}

impl Effect for ImuLatency {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Latency::specs(model)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let late_s = Latency::of(values).t_s;
        model.sensors.gyro.errors.latency_s += late_s;
        model.sensors.accelerometer.errors.latency_s += late_s;
        Ok(())
    }

    fn imu_latency_s(&self, values: &[f64]) -> Option<f64> {
        Some(Latency::of(values).t_s)
    }
}
