//! Drag in a wheel's bearing and motor.

use super::parameter::value;
use super::{Effect, EffectError, EffectInfo, EffectKind, ParameterSpec};
use crate::PlatformModel;

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

impl Effect for WheelFriction {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        model
            .wheels()
            .iter()
            .enumerate()
            .flat_map(|(j, wheel)| {
                let largest = wheel.max_torque_n_m;
                [
                    ParameterSpec::new(
                        format!("{}_viscous_n_m_s", wheel.name),
                        "N m s",
                        (0.0, largest / wheel.max_speed_rad_s),
                        0.05 * largest / wheel.max_speed_rad_s,
                        "Viscous drag added to the model's.",
                    ).of_wheel(j),
                    ParameterSpec::new(
                        format!("{}_coulomb_n_m", wheel.name),
                        "N m",
                        (0.0, largest),
                        0.02 * largest,
                        "Coulomb drag added to the model's.",
                    ).of_wheel(j),
                ]
            })
            .collect()
    }

    fn adjust(&self, values: &[f64], model: &mut PlatformModel) -> Result<(), EffectError> {
        for (j, wheel) in model.wheels_mut().iter_mut().enumerate() {
            wheel.viscous_friction_n_m_s += value(values, 2 * j);
            wheel.coulomb_friction_n_m += value(values, 2 * j + 1);
        }
        Ok(())
    }
}
