//! Steady draught in the laboratory.

use nalgebra::Vector3;

use super::parameter::{per_axis, vector};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct AirCurrent;

static INFO: EffectInfo = EffectInfo {
    id: "air_current",
    title: "steady air current",
    explanation: "A steady draught pushes with a torque that is constant in the room, so it turns in the body as the platform yaws.",
    equation: "g = R^T t_world",
    source: "air currents of Schwartz 2004, Table 3.1 and section 4.3",
    kind: EffectKind::Torque,
    confusable_with: &["magnetic_torque", "bearing_turbine", "mass_shift"],
    separated_by: "slow yaw by 90 and 180 degrees at fixed tilt, then a tilt change",
    is_passive: false,
};

impl Effect for AirCurrent {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        per_axis("t", "_n_m", "N m", 0.5, 0.005, "Torque about this world axis (east, north, up).")
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        environment.to_body(&vector(values, 0))
    }
}
