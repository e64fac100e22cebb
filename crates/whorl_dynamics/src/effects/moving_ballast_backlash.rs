//! Play in the linear mass actuators.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct MovingBallastBacklash;

static INFO: EffectInfo = EffectInfo {
    id: "moving_ballast_backlash",
    title: "backlash of the linear mass actuators",
    explanation: "The moving mass lags behind its spindle by half the play, to the side it last came from, so the balance jumps whenever an actuator reverses.",
    equation: "d(m g r)_i = -1/2 gap_i sense_i, g = -d(m g r) x k_b",
    source: "mass shift in bearings and loose fits of Schwartz 2004, Table 3.1; play operator after contact",
    kind: EffectKind::Torque,
    confusable_with: &["mass_shift"],
    separated_by: "move each actuator to the same place from both sides",
    is_passive: false,
};

parameters! {
    Backlash(_model: PlatformModel) {
        gap_b_n_m: Vector3<f64> = ["gap_x_n_m", "gap_y_n_m", "gap_z_n_m"].map(|name| {
            ParameterSpec::new(name, "N m", (0.0, 1.0), 0.02, "Play times the weight of the moving mass.")
        }),
    }
}

impl Effect for MovingBallastBacklash {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Backlash::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        0.5 * Backlash::of(values).gap_b_n_m.component_mul(&environment.ballast_direction).cross(&environment.vertical_b)
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::FreeBody, Need::Ballast]]
    }
}
