//! Gyro axes that are neither along the body's nor square to each other.

use super::parameter::value;
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

/// (row, column) of each parameter.
const ELEMENTS: [(usize, usize); 6] = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)];

impl Effect for GyroMisalignment {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        ["xy_rad", "xz_rad", "yx_rad", "yz_rad", "zx_rad", "zy_rad"]
            .map(|name| {
                ParameterSpec::new(name, "rad", (-0.2, 0.2), 0.01, "First letter: axis that reads; second: axis that turns.")
            })
            .into()
    }

    fn measure_imu(&self, values: &[f64], _environment: &Environment<'_>, imu: &mut TrueImu) {
        let rate = imu.angular_velocity_b_rad_s;
        for (i, (row, column)) in ELEMENTS.into_iter().enumerate() {
            imu.angular_velocity_b_rad_s[row] += value(values, i) * rate[column];
        }
    }
}
