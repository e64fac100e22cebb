//! Gyro that is sensitive to acceleration.

use nalgebra::Matrix3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec, TrueImu};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct GyroGSensitivity;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_g_sensitivity",
    title: "gyro bias follows specific force",
    explanation: "The gyro's elements bend under acceleration, so its bias follows tilt although no torque acts.",
    equation: "y = w + G f, f = specific force at the accelerometer",
    source: "linear acceleration sensitivity, IEEE Std 1431",
    kind: EffectKind::Sensor,
    confusable_with: &["gyro_bias", "gravity_offset"],
    separated_by: "rest at several tilts",
    is_passive: false,
};

parameters! {
    Sensitivity(_model: PlatformModel) {
        g_s_m: [f64; 9] = ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"].map(|element| {
            ParameterSpec::new(
                format!("{element}_s_m"),
                "s/m",
                (-0.01, 0.01),
                2e-4,
                "Rate read per specific force; first letter: axis that reads, second: axis of the force.",
            )
        }),
    }
}

impl Effect for GyroGSensitivity {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Sensitivity::specs(model)
    }

    fn measure_imu(&self, values: &[f64], _environment: &Environment<'_>, imu: &mut TrueImu) {
        // Rows are the axes that read.
        let sensitivity = Matrix3::from_row_slice(&Sensitivity::of(values).g_s_m);
        imu.angular_velocity_b_rad_s += sensitivity * imu.specific_force_b_m_s2;
    }
}
