//! Actuators that follow the bus voltage.

use super::parameter::value;
use super::{Effect, EffectInfo, EffectKind, ParameterSpec};
use crate::{Environment, PlatformModel};

#[derive(Debug)]
pub(super) struct SupplyVoltage;

static INFO: EffectInfo = EffectInfo {
    id: "supply_voltage",
    title: "actuators depend on the bus voltage",
    explanation: "As the battery falls, wheel motors give less torque for the same command and valves open later.",
    equation: "u_j = u_command (1 + s (V - V0)), t_open = t_model + s_valve (V0 - V), V0 = full battery",
    source: "motor performance changes as the bus voltage drops: Schwartz 2004, section 4.1.1; linearised",
    kind: EffectKind::Actuator,
    confusable_with: &["thruster_pressure", "wheel_inertia"],
    separated_by: "the same manoeuvre with a full and a low battery",
    is_passive: false,
};

/// Volts below a full battery.
fn drop_v(environment: &Environment<'_>) -> f64 {
    environment.model.bus.initial_v - environment.bus_voltage_v
}

impl Effect for SupplyVoltage {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, _model: &PlatformModel) -> Vec<ParameterSpec> {
        vec![
            ParameterSpec::new("wheel_torque_per_v", "1/V", (0.0, 0.2), 0.02, "Relative loss of motor torque per volt."),
            ParameterSpec::new("valve_delay_s_v", "s/V", (0.0, 0.05), 0.002, "Later opening of valves per volt lost."),
        ]
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        let loss = value(values, 0) * drop_v(environment);
        for (j, torque) in torque_n_m.iter_mut().enumerate() {
            *torque -= loss * environment.wheel_motor_torque(j);
        }
    }

    fn valve_delay_s(&self, values: &[f64], environment: &Environment<'_>) -> (f64, f64) {
        (value(values, 1) * drop_v(environment).max(0.0), 0.0)
    }
}
