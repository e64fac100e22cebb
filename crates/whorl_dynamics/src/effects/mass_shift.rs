//! A centre of mass that moves as gas is used.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::per_axis;
use super::{Aid, Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct MassShift;

static INFO: EffectInfo = EffectInfo {
    id: "mass_shift",
    title: "centre of mass moves as gas is used",
    explanation: "The tank is not at the centre of rotation, so each gram of gas used moves the balance: the gravity offset drifts with the cumulative impulse of the jets.",
    equation: "g = -(s m_used) x k_b",
    source: "reaction jet supply discharge of Schwartz 2004, Table 3.1 and section 4.1.1",
    kind: EffectKind::Torque,
    confusable_with: &["air_current", "thruster_pressure"],
    separated_by: "the same manoeuvre with a full and an empty tank",
    is_passive: false,
};

parameters! {
    Shift(_model: PlatformModel) {
        shift_b_n_m_kg: Vector3<f64> = per_axis(
            "shift",
            "_n_m_kg",
            "N m/kg",
            50.0,
            3.0,
            "Change of m g r_cg along this body axis per kilogram of gas used (gas at r leaves -g r).",
        ),
    }
}

impl Effect for MassShift {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Shift::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        -(Shift::of(values).shift_b_n_m_kg * environment.gas_used_kg).cross(&environment.vertical_b)
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets]]
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::TankPressure]
    }
}
