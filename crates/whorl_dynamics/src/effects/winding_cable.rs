//! A cable to the base that winds up turn by turn.

use std::f64::consts::PI;

use nalgebra::Vector3;
use whorl_math::wrap_angle_rad;

use super::named::{Named as _, Value as _, parameters};
use super::parameter::USUAL_TORQUE_N_M;
use super::{Clues, Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec, Start, Starter};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct WindingCable;

static INFO: EffectInfo = EffectInfo {
    id: "winding_cable",
    title: "cable to the base that winds up",
    explanation: "A cable along the vertical, fixed at both ends, twists further with every turn: its torque grows with the heading counted over whole turns, where a hose that only pulls to one heading would start again.",
    equation: "g = -(k psi + c w.k_b) k_b, psi = wrap(yaw_start - yaw0) + the angle turned about the vertical since then",
    source: "linear torsion spring about the vertical; electrical wire to base of Schwartz 2004, Table 3.1",
    kind: EffectKind::HiddenState,
    confusable_with: &["harness_spring", "bearing_viscous_friction", "air_current"],
    separated_by: "turn once and more, then release: within half a turn of the relaxed heading both cables are the same",
    is_passive: false,
};

parameters! {
    Cable(model: PlatformModel) {
        // Without its stiffness the cable's damping cannot be distinguished from friction.
        k_n_m_rad: f64 = ParameterSpec::new(
            K,
            "N m/rad",
            (0.0, 1000.0 * USUAL_TORQUE_N_M),
            2.0 * USUAL_TORQUE_N_M,
            "Stiffness.",
        )
        .essential(),
        yaw0_rad: f64 = ParameterSpec::new(
            YAW0,
            "rad",
            (-PI, PI),
            PI,
            "Heading at which the cable is relaxed, within half a turn of the start of each run.",
        )
        .floating_shape()
        .angle(),
        c_n_m_s: f64 = ParameterSpec::new(
            C,
            "N m s",
            (0.0, 1000.0 * USUAL_TORQUE_N_M),
            2.0 * USUAL_TORQUE_N_M,
            "Damping about the vertical.",
        ),
    }
}

const K: &str = "k_n_m_rad";
const YAW0: &str = "yaw0_rad";
const C: &str = "c_n_m_s";

/// Relaxed headings that are tried.
const HEADINGS: u32 = 4;

/// Rate of turn about the vertical [rad/s].
fn turn_rate_rad_s(environment: &Environment<'_>) -> f64 {
    environment.omega_wb_b_rad_s.dot(&environment.vertical_b)
}

impl Effect for WindingCable {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    /// Within half a turn it is the plain cable.
    fn evidence(&self) -> Evidence {
        &[&[Need::FreeBody, Need::HalfATurn]]
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Cable::specs(model)
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        // Angle turned about the vertical since the start of the run [rad].
        1
    }

    fn hidden_derivative(
        &self,
        _values: &[f64],
        environment: &Environment<'_>,
        _hidden: &[f64],
        derivative: &mut [f64],
    ) {
        if let [turned] = derivative {
            *turned = turn_rate_rad_s(environment);
        }
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        let cable = Cable::of(values);
        // The count only chooses the turn; the heading itself is the attitude's, so that errors of the count do not
        // add up.
        let turned_rad = f64::read(hidden);
        let twist_rad = wrap_angle_rad(environment.yaw_rad() - turned_rad - cable.yaw0_rad) + turned_rad;
        -(cable.k_n_m_rad * twist_rad + cable.c_n_m_s * turn_rate_rad_s(environment)) * environment.vertical_b
    }

    fn starts(&self, model: &PlatformModel, _clues: &Clues<'_>) -> Option<Vec<Start>> {
        let starter = Starter::new(self, model);
        let heading = |i: u32| -PI + 2.0 * PI * (f64::from(i) + 0.5) / f64::from(HEADINGS);
        let starts = (0..HEADINGS).flat_map(|i| {
            let origin = starter.at(&[(YAW0, heading(i))]);
            let stiffness = starter.along(&origin, K);
            [vec![stiffness.clone()], vec![stiffness, starter.along(&origin, C)]]
        });
        Some(starts.collect())
    }
}
