//! Thrust that depends on the tank's pressure differently from the model.

use super::named::{Named as _, parameters};
use super::{Aid, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;

#[derive(Debug)]
pub(super) struct ThrusterPressure;

static INFO: EffectInfo = EffectInfo {
    id: "thruster_pressure",
    title: "thrust follows tank pressure",
    explanation: "The regulator is not perfect: thrust falls as the tank empties by another law than the model's.",
    equation: "F = F_ref (p / p_ref)^(n_model + exponent)",
    source: "choked nozzle: thrust proportional to feed pressure (Sutton, Rocket Propulsion Elements, eq. 3-29); exponent for an imperfect regulator",
    kind: EffectKind::Actuator,
    confusable_with: &["mass_shift", "supply_voltage", "thruster_strength"],
    separated_by: "the same pulses with a full and an empty tank",
    is_passive: false,
};

parameters! {
    Pressure(_model: PlatformModel) {
        exponent: f64 = ParameterSpec::new("exponent", "1", (-2.0, 2.0), 0.3, "Added to the model's exponent."),
    }
}

impl Effect for ThrusterPressure {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Pressure::specs(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        model.tank_mut().thrust_pressure_exponent += Pressure::of(values).exponent;
        Ok(())
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Jets]]
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::TankPressure]
    }
}
