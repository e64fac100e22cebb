//! Spin torque of the bearing's air.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct BearingTurbine;

static INFO: EffectInfo = EffectInfo {
    id: "bearing_turbine",
    title: "turbine torque of the bearing",
    explanation: "Scratches or uneven holes make the bearing's air turn the platform: it accelerates one yaw direction and brakes the other.",
    equation: "g = t_body z_b + t_vertical k_b",
    source: "aerodynamic turbine effect of Schwartz 2004, Table 3.1 (in the ball: about body z; in the cup: about the vertical)",
    kind: EffectKind::Torque,
    confusable_with: &["air_current", "thruster_leak"],
    separated_by: "both spin directions; both tilted and level",
    is_passive: false,
};

parameters! {
    Turbine(_model: PlatformModel) {
        body_z_n_m: f64 = ParameterSpec::new("body_z_n_m", "N m", (-0.5, 0.5), 0.003, "Torque about body z."),
        vertical_n_m: f64 = ParameterSpec::new("vertical_n_m", "N m", (-0.5, 0.5), 0.003, "Torque about the vertical."),
    }
}

impl Effect for BearingTurbine {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Turbine::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let turbine = Turbine::of(values);
        Vector3::z() * turbine.body_z_n_m + environment.vertical_b * turbine.vertical_n_m
    }
}
