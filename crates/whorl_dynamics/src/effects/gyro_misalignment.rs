//! Gyro axes that are neither parallel to the body's nor orthogonal to each other.

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec, TrueImu};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct GyroMisalignment;

static INFO: EffectInfo = EffectInfo {
    id: "gyro_misalignment",
    title: "gyro axes tilted",
    explanation: "Each gyro axis also senses a little of the other two rates: a cross-axis kinematic residual.",
    equation: "y_i = w_i + sum over j != i of m_ij w_j",
    source: "definition (first order in the six angles)",
    kind: EffectKind::Sensor,
    confusable_with: &["inertia_products"],
    separated_by: "turn about each axis in turn",
    is_passive: false,
};

/// Each parameter's name, row and column.
const ELEMENTS: [(&str, usize, usize); 6] =
    [("xy_rad", 0, 1), ("xz_rad", 0, 2), ("yx_rad", 1, 0), ("yz_rad", 1, 2), ("zx_rad", 2, 0), ("zy_rad", 2, 1)];

parameters! {
    Tilt(_model: PlatformModel) {
        m_rad: [f64; 6] = ELEMENTS.map(|(name, ..)| {
            ParameterSpec::new(name, "rad", (-0.2, 0.2), 0.01, "First letter: axis that reads; second: axis that turns.")
        }),
    }
}

impl Effect for GyroMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Tilt::specs(model)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn measure_imu(&self, values: &[f64], _environment: &Environment<'_>, imu: &mut TrueImu) {
        let rate = imu.angular_velocity_b_rad_s;
        for ((_, row, column), m) in ELEMENTS.into_iter().zip(Tilt::of(values).m_rad) {
            imu.angular_velocity_b_rad_s[row] += m * rate[column];
        }
    }
}
