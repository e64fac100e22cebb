//! Valves later than in the model.

use super::named::{Named as _, parameters};
use super::{BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::platform::Jet;

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

parameters! {
    Delay(model: PlatformModel) {
        t_on_s: f64 = ParameterSpec::new(
            "t_on_s",
            "s",
            (-shortest_s(model, |jet| jet.opening_delay_s), 0.5),
            0.01,
            "Added delay of opening.",
        )
        .base(BasePrior::OpeningDelay),
        t_off_s: f64 = ParameterSpec::new(
            "t_off_s",
            "s",
            (-shortest_s(model, |jet| jet.closing_delay_s), 0.5),
            0.01,
            "Added delay of closing.",
        )
        .base(BasePrior::ClosingDelay),
    }
}

/// The shortest of a delay of the jets: no valve acts before its command.
fn shortest_s(model: &PlatformModel, of: impl Fn(&Jet) -> f64) -> f64 {
    model.jets().iter().map(of).reduce(f64::min).unwrap_or(0.0)
}

impl Effect for ThrusterDelay {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Delay::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        let delay = Delay::of(values);
        for jet in model.jets_mut() {
            jet.opening_delay_s += delay.t_on_s;
            jet.closing_delay_s += delay.t_off_s;
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets]]
    }
}
