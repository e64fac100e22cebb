//! A wheel's motor that pushes without a command.

use super::named::{Named as _, parameters, per_wheel};
use super::{Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::platform::Wheel;
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct WheelMotorBias;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_motor_bias",
    title: "wheel motor with an offset",
    explanation: "The drive's current sensor has an offset, so the motor gives a constant torque besides the one commanded: the wheel drifts without a command, in one sense whichever way it turns, and the body takes the opposite.",
    equation: "torque on wheel j = u_command_j + b_j; the body takes the opposite",
    source: "offset of a current loop (Krause et al., Analysis of Electric Machinery and Drive Systems: torque in proportion to current)",
    kind: EffectKind::Actuator,
    // While a wheel turns one way only, its dry friction is a constant torque too.
    confusable_with: &["wheel_friction", "bearing_turbine", "air_current"],
    separated_by: "the wheel through zero to both senses without a command: friction changes sign, a bias does not; its speed tells it from a torque on the body",
    is_passive: false,
};

parameters! {
    /// Of one wheel.
    Bias(wheel: Wheel) {
        torque_n_m: f64 = ParameterSpec::new(
            "_n_m",
            "N m",
            (-wheel.max_torque_n_m, wheel.max_torque_n_m),
            0.01 * wheel.max_torque_n_m,
            "Torque of the motor added to the command.",
        ),
    }
}

impl Effect for WheelMotorBias {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Bias>(model)
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], _environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        for (j, torque) in torque_n_m.iter_mut().enumerate() {
            *torque += Bias::nth(values, j).torque_n_m;
        }
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Wheels, Need::WheelCommands]]
    }
}
