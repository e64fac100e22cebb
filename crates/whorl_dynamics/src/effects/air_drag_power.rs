//! Drag with an exponent that the data choose.

use nalgebra::Vector3;

use super::named::{Named as _, parameters};
use super::parameter::USUAL_TORQUE_N_M;
use super::{Clues, Effect, EffectInfo, EffectKind, ParameterSpec, Regressed, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct AirDragPower;

static INFO: EffectInfo = EffectInfo {
    id: "air_drag_power",
    title: "drag with a free exponent",
    explanation: "Boundary layers and mixed flow brake with a power of the rate between the first (creeping flow) and a little over the second (rough, turbulent): neither of the two plain laws fits the whole spin-down.",
    equation: "g = -d (|w| / w_ref)^p w/|w|, w_ref = 0.1 rad/s, p = 1 .. 2.5",
    source: "drag of rotating bodies by regime: p = 1 creeping, 1.5 laminar boundary layer, 1.8 turbulent (Schlichting, Boundary-Layer Theory, rotating disk)",
    kind: EffectKind::Torque,
    confusable_with: &["air_drag_quadratic", "bearing_viscous_friction", "bearing_coulomb_friction"],
    separated_by: "coast down over at least 10:1 in rate",
    is_passive: true,
};

parameters! {
    Power(model: PlatformModel) {
        d_n_m: f64 = ParameterSpec::new(
            D,
            "N m",
            (0.0, 1000.0 * USUAL_TORQUE_N_M),
            0.2 * USUAL_TORQUE_N_M,
            "Torque at 0.1 rad/s.",
        ),
        exponent: f64 = ParameterSpec::new(EXPONENT, "1", (1.0, 2.5), 0.3, "Power of the rate.")
            .with_neutral(1.5)
            .shape()
            .regressed(Regressed::WithAmplitude),
    }
}

const D: &str = "d_n_m";
const EXPONENT: &str = "exponent";

/// Rate at which the amplitude is stated [rad/s]: in the middle of the rates of spin-downs, so that amplitude and
/// exponent are nearly independent in a fit.
const REFERENCE_RAD_S: f64 = 0.1;

/// Exponents that are tried. The plain laws, p = 1 and 2, have names of their own.
const EXPONENTS: [f64; 3] = [1.25, 1.5, 1.75];

impl Effect for AirDragPower {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Power::specs(model)
    }

    fn prior_penalty_nats(&self) -> f64 {
        // The plain laws are its ends: one in twenty drags is neither.
        3.0
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let power = Power::of(values);
        let relative = environment.omega_wb_b_rad_s / REFERENCE_RAD_S;
        let size = relative.norm();
        if size > 0.0 { -power.d_n_m * size.powf(power.exponent - 1.0) * relative } else { Vector3::zeros() }
    }

    fn starts(&self, model: &PlatformModel, _clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let start = |exponent: f64| vec![starter.along(&starter.at(&[(EXPONENT, exponent)]), D)];
        Some(EXPONENTS.into_iter().map(start).collect())
    }
}
