//! Valves later than the model says.

use super::parameter::value;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ThrusterDelay;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_delay",
    title: "valves open and close late",
    explanation: "Every valve opens and closes later than the model says: a doublet of residual at each edge, and a changed impulse when the two differ.",
    equation: "opens at t_command + t_model + t_on, closes at t_end + t_model + t_off",
    source: "solenoid valve response; definition",
    kind: EffectKind::Actuator,
    confusable_with: &["thruster_rise", "thruster_strength", "imu_latency"],
    separated_by: "one jet alone, two pulse lengths; latency also delays the wheels' response",
    is_passive: false,
};

impl Effect for ThrusterDelay {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        vec![
            ParameterSpec::new("t_on_s", "s", (0.0, 0.5), 0.01, "Added delay of opening."),
            ParameterSpec::new("t_off_s", "s", (0.0, 0.5), 0.01, "Added delay of closing."),
        ]
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for jet in model.jets_mut() {
            jet.opening_delay_s += value(values, 0);
            jet.closing_delay_s += value(values, 1);
        }
        Ok(())
    }
}
