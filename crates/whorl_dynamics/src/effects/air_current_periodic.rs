//! Draught of a climate control that cycles.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::parameter::{per_axis, value, vector};
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct AirCurrentPeriodic;

static INFO: EffectInfo = EffectInfo {
    id: "air_current_periodic",
    title: "periodic air current",
    explanation: "The building's climate control pushes back and forth with a torque fixed in the room: a line in the spectrum that has nothing to do with the motion.",
    equation: "g = R^T a_world sin(2 pi f t + phase)",
    source: "climate control of Schwartz 2004, section 4.3",
    kind: EffectKind::Torque,
    confusable_with: &["slosh", "air_current"],
    separated_by: "hold still: the line stays although nothing excites it",
    is_passive: false,
};

impl Effect for AirCurrentPeriodic {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        let mut specs = per_axis("amplitude", "_n_m", "N m", 0.5, 0.005, "Amplitude about this world axis.");
        specs.push(ParameterSpec::new("frequency_hz", "Hz", (0.0, 10.0), 0.1, "Frequency.").with_neutral(0.1));
        specs.push(ParameterSpec::new("phase_rad", "rad", (-PI, PI), PI, "Phase at the start of the run."));
        specs
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        let phase = TAU * value(values, 3) * environment.time_s + value(values, 4);
        environment.to_body(&vector(values, 0)) * phase.sin()
    }
}
