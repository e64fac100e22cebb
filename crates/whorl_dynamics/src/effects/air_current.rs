//! Steady draught in the laboratory.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Aid, Effect, EffectInfo, EffectKind, Grouping, ParameterSpec};
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

parameters! {
    Torque(_model: PlatformModel) {
        t_w_n_m: Vector3<f64> = per_axis("t", "_n_m", "N m", 0.5, 0.005, "Torque about this world axis (east, north, up)."),
    }
}

impl Effect for AirCurrent {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Torque::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        environment.to_body(&Torque::of(values).t_w_n_m)
    }

    fn grouping(&self) -> Grouping {
        // A draught along the floor.
        Grouping::AllPartsEach(&[&["t_x_n_m", "t_y_n_m"]])
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::Heading]
    }
}
