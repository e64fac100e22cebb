//! A wheel's motor that gives more or less than it is asked for.

use super::named::{Named as _, parameters, per_wheel};
use super::{Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
use crate::platform::Wheel;
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct WheelMotorConstant;

static INFO: EffectInfo = EffectInfo {
    id: "wheel_motor_constant",
    title: "wheel motor constant off by a factor",
    explanation: "The motor turns the commanded current into more or less torque than the drive assumes: wheel and body both answer a command by the same factor too much or too little.",
    equation: "torque on wheel j = u_command_j (1 + k_j); the body takes the opposite",
    source: "torque constant of a permanent-magnet motor, tolerance of magnets and temperature: some per cent",
    kind: EffectKind::Actuator,
    // An inertia that is off changes the speed alone: on a clamped platform, where nothing shows the reaction on the
    // body, the two are one.
    confusable_with: &["wheel_inertia", "supply_voltage", "wheel_friction"],
    separated_by: "wheel steps on a free platform: a wrong inertia changes the wheel's speed, a wrong constant its speed and the body's rate alike",
    is_passive: false,
};

parameters! {
    /// Of one wheel.
    Constant(_wheel: Wheel) {
        error: f64 = ParameterSpec::new("", "1", (-0.9, 2.0), 0.05, "Relative error of this motor's torque."),
    }
}

impl Effect for WheelMotorConstant {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        per_wheel::<Constant>(model)
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        for (j, torque) in torque_n_m.iter_mut().enumerate() {
            *torque += Constant::nth(values, j).error * environment.available_motor_torque(j);
        }
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Wheels, Need::WheelCommands]]
    }
}
