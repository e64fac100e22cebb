//! Pressure drag of the platform's parts in still air.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct AirDragQuadratic;

static INFO: EffectInfo = EffectInfo {
    id: "air_drag_quadratic",
    title: "quadratic air drag",
    explanation: "Parts that stand in the wind of the rotation brake with the square of the rate: spin decays faster at speed and then lingers; a flat deck drags differently about each axis.",
    equation: "g = -|w| diag(d_x, d_y, d_z) w",
    source: "bluff-body drag with C_D = 1 (Schwartz 2004, section 4.3.3): d = 1/2 rho C_D A r^3",
    kind: EffectKind::Torque,
    confusable_with: &["bearing_viscous_friction", "bearing_coulomb_friction"],
    separated_by: "coast down over at least 10:1 in rate",
    is_passive: true,
};

parameters! {
    Drag(_model: PlatformModel) {
        d_b_n_m_s2: Vector3<f64> = ["dx_n_m_s2", "dy_n_m_s2", "dz_n_m_s2"].map(|name| {
            ParameterSpec::new(name, "N m s^2", (0.0, 5.0), 0.05, "Torque about this body axis per squared rate.")
        }),
    }
}

impl Effect for AirDragQuadratic {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Drag::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let omega = environment.omega_wb_b_rad_s;
        -omega.norm() * Drag::of(values).d_b_n_m_s2.component_mul(&omega)
    }
}
