//! Gyro bias that follows temperature.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec, TrueImu};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct GyroTemperature;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_temperature",
    title: "gyro bias follows temperature",
    explanation: "As the sensor warms up its bias moves with the temperature channel.",
    equation: "y = w + c (T - T_ambient)",
    source: "temperature variation of the MotionPak II, Schwartz 2004, section 4.4; linearised",
    kind: EffectKind::Sensor,
    confusable_with: &["gyro_bias"],
    separated_by: "rest while the platform warms up and while it is warm",
    is_passive: false,
};

parameters! {
    Slope(_model: PlatformModel) {
        slope_rad_s_k: Vector3<f64> = per_axis("slope", "_rad_s_k", "rad/(s K)", 0.01, 3e-4, "Change of bias per kelvin above ambient."),
    }
}

impl Effect for GyroTemperature {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Slope::specs(model)
    }

    fn measure_imu(&self, values: &[f64], environment: &Environment<'_>, imu: &mut TrueImu) {
        let warming_k = environment.temperature_k - environment.model.sensors.ambient_temperature_k;
        imu.angular_velocity_b_rad_s += Slope::of(values).slope_rad_s_k * warming_k;
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::FreeBody, Need::Temperature]]
    }
}
