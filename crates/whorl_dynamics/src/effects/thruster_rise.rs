//! Thrust that builds up and tails off.

use super::parameter::value;
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ThrusterRise;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_rise",
    title: "gradual build-up and tail-off of thrust",
    explanation: "The volume behind the nozzle fills and empties, so thrust follows the valve with a lag: a tail after each edge, and the impulse unchanged.",
    equation: "tau df/dt = valve - f, F = F_nominal f",
    source: "first-order plenum filling; solved in closed form between valve edges",
    kind: EffectKind::Actuator,
    confusable_with: &["thruster_delay", "thruster_strength"],
    separated_by: "one jet alone, two pulse lengths",
    is_passive: false,
};

impl Effect for ThrusterRise {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        vec![ParameterSpec::new("tau_s", "s", (0.0, 0.5), 0.01, "Time constant, the same for all jets.")]
    }

    fn jet_rise_time_s(&self, values: &[f64]) -> f64 {
        value(values, 0)
    }
}

/// Share of a step that is still missing `elapsed_s` after it, for the lag above: exp(-t/tau), 0 for
/// no lag.
#[must_use]
pub fn remaining_after_step(elapsed_s: f64, time_constant_s: f64) -> f64 {
    if time_constant_s > 0.0 { (-elapsed_s / time_constant_s).exp() } else { 0.0 }
}
