//! Thrust that follows the bus voltage.

use super::named::{Named as _, parameters};
use super::{Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct ThrusterVoltage;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_voltage",
    title: "thrust follows the bus voltage",
    explanation: "As the battery falls, the solenoids lift less and the valves let less gas through, or fans and pumps give less: all thrust falls in proportion.",
    equation: "F = F_model (1 + s (V - V0)), V0 = full battery",
    source: "solenoid force and motor speed follow the supply: Schwartz 2004, section 4.1.1; linearised",
    kind: EffectKind::Actuator,
    confusable_with: &["thruster_pressure", "thruster_strength", "supply_voltage"],
    separated_by: "the same pulses with a full and a low battery at one tank pressure",
    is_passive: false,
};

parameters! {
    Voltage(_model: PlatformModel) {
        thrust_per_v: f64 = ParameterSpec::new("thrust_per_v", "1/V", (0.0, 0.5), 0.03, "Relative loss of thrust per volt lost."),
    }
}

impl Effect for ThrusterVoltage {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Voltage::specs(model)
    }

    fn thrust_factor(&self, values: &[f64], environment: &Environment<'_>) -> f64 {
        let change_v = environment.bus_voltage_v - environment.model.bus.full_v;
        // A supply near zero gives no thrust, not a negative one.
        (1.0 + Voltage::of(values).thrust_per_v * change_v).max(0.0)
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets, Need::BusVoltage]]
    }
}
