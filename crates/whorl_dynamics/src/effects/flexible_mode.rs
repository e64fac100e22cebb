//! An appendage that vibrates.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::parameter::{per_axis, value, vector};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct FlexibleMode;

static INFO: EffectInfo = EffectInfo {
    id: "flexible_mode",
    title: "flexible appendage",
    explanation: "One vibration mode of a boom or panel: a narrow line that jets and wheels excite.",
    equation: "eta'' + 2 zeta W eta' + W^2 eta = -d . dw/dt, g = -d eta'', W = 2 pi f",
    source: "Likins 1970, hybrid coordinates, one mode, small deflections; the appendage at rest is part of the platform's inertia",
    kind: EffectKind::HiddenState,
    confusable_with: &["slosh", "vibration_alias"],
    separated_by: "single-jet pulses, then rest",
    is_passive: false,
};

/// -2 zeta W eta' - W^2 eta.
fn restoring(values: &[f64], hidden: &[f64]) -> f64 {
    let omega_rad_s = TAU * value(values, 3);
    -2.0 * value(values, 4) * omega_rad_s * value(hidden, 1) - omega_rad_s.powi(2) * value(hidden, 0)
}

impl Effect for FlexibleMode {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        let mut specs =
            per_axis("participation", "_sqrt_kg_m", "sqrt(kg) m", 2.0, 0.1, "Participation of this body axis.");
        specs.push(ParameterSpec::new("frequency_hz", "Hz", (0.05, 50.0), 1.0, "Frequency with the body held.").with_neutral(5.0));
        specs.push(ParameterSpec::new("damping_ratio", "1", (0.0, 1.0), 0.01, "Damping over critical.").with_neutral(0.005));
        specs
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        // eta and its rate.
        2
    }

    fn hidden_derivative(
        &self,
        values: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        derivative: &mut [f64],
    ) {
        if let [position, rate] = derivative {
            *position = value(hidden, 1);
            *rate = restoring(values, hidden) - vector(values, 0).dot(&environment.omega_dot_wb_b_rad_s2);
        }
    }

    fn torque_b_n_m(&self, values: &[f64], _environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        // eta'' without its share of dw/dt, which `reaction_inertia_b_kg_m2` carries.
        -restoring(values, hidden) * vector(values, 0)
    }

    fn reaction_inertia_b_kg_m2(&self, values: &[f64], _model: &PlatformModel) -> Matrix3<f64> {
        let d = vector(values, 0);
        d * d.transpose()
    }
}
