//! Drag in a wheel's bearing and motor.

use super::named::{Named as _, parameters, per_wheel};
use super::{Aid, BasePrior, Effect, EffectError, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::PlatformModel;
use crate::platform::Wheel;

#[derive(Debug)]
pub(super) struct WheelFriction;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_friction",
    title: "wheel bearing friction",
    explanation: "A wheel slows down without a command, and the body takes the torque.",
    equation: "torque on wheel j = -b_j Om_j - T_j sign(Om_j), stuck at Om_j = 0 while |drive| <= T_j; the body takes the opposite",
    source: "viscous and Coulomb friction (Bialke, High fidelity mathematical modeling of reaction wheel performance, AAS 98-063)",
    kind: EffectKind::Actuator,
    confusable_with: &["wheel_windage", "wheel_inertia"],
    separated_by: "wheel coast-down from high speed to a stop",
    is_passive: false,
};

parameters! {
    /// Of one wheel.
    Drag(wheel: Wheel) {
        viscous_n_m_s: f64 = ParameterSpec::new(
            "_viscous_n_m_s",
            "N m s",
            // The largest speed that is stated is rarely the one that is reached.
            (-wheel.viscous_friction_n_m_s, 20.0 * wheel.max_torque_n_m / wheel.max_speed_rad_s),
            0.05 * wheel.max_torque_n_m / wheel.max_speed_rad_s,
            "Viscous drag added to the model's.",
        )
        .base(BasePrior::WheelViscousFriction),
        coulomb_n_m: f64 = ParameterSpec::new(
            "_coulomb_n_m",
            "N m",
            (-wheel.coulomb_friction_n_m, wheel.max_torque_n_m),
            0.02 * wheel.max_torque_n_m,
            "Coulomb drag added to the model's.",
        )
        .base(BasePrior::WheelCoulombFriction),
    }
}

impl Effect for WheelFriction {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Drag>(model)
    }

    fn is_correction(&self) -> bool {
        true
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, wheel) in model.wheels_mut().iter_mut().enumerate() {
            let drag = Drag::nth(values, j);
            wheel.viscous_friction_n_m_s += drag.viscous_n_m_s;
            wheel.coulomb_friction_n_m += drag.coulomb_n_m;
        }
        Ok(())
    }

    fn is_base(&self) -> bool {
        true
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Wheels, Need::WheelCommands]]
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::WheelSpeed]
    }
}
