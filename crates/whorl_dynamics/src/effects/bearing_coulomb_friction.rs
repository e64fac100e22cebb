//! Rubbing contact in the bearing.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct BearingCoulombFriction;

/// Below this rate the direction of the torque fades out [rad/s]: with 0.05 N m on 6 kg m^2 the
/// final creep has a time constant of 60 ms, which a 1 ms step integrates.
const SMOOTHING_RATE_RAD_S: f64 = 5e-4;

static INFO: EffectInfo = EffectInfo {
    id: "bearing_coulomb_friction",
    title: "dry friction of the bearing",
    explanation: "Dust or contact in the bearing brakes with the same torque at any speed: spin falls on a straight line and stops suddenly.",
    equation: "g = -T w / sqrt(|w|^2 + w0^2), w0 = 5e-4 rad/s",
    source: "Coulomb's law, regularised; constant friction of the bearing, Schwartz 2004, section 4.3.3",
    kind: EffectKind::Torque,
    confusable_with: &["bearing_viscous_friction", "air_drag_quadratic"],
    separated_by: "coast down over at least 10:1 in rate, to a full stop",
    is_passive: true,
};

parameters! {
    Friction(_model: PlatformModel) {
        torque_n_m: f64 = ParameterSpec::new("torque_n_m", "N m", (0.0, 0.5), 0.005, "Size of the braking torque."),
    }
}

impl Effect for BearingCoulombFriction {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Friction::specs(model)
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let omega = environment.omega_wb_b_rad_s;
        omega * (-Friction::of(values).torque_n_m / omega.norm().hypot(SMOOTHING_RATE_RAD_S))
    }

    fn holding_torque_n_m(&self, values: &[f64]) -> f64 {
        Friction::of(values).torque_n_m
    }
}
