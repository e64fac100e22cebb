//! Actuators that follow the bus voltage.

use super::named::{Named as _, parameters};
use super::{Aid, Effect, EffectInfo, EffectKind, Evidence, Need, ParameterSpec};
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

parameters! {
    Voltage(_model: PlatformModel) {
        wheel_torque_per_v: f64 = ParameterSpec::new("wheel_torque_per_v", "1/V", (0.0, 0.2), 0.02, "Relative loss of motor torque per volt."),
        valve_delay_s_v: f64 = ParameterSpec::new("valve_delay_s_v", "s/V", (0.0, 0.05), 0.002, "Later opening of valves per volt lost."),
    }
}

/// Volts below a full battery.
fn drop_v(environment: &Environment<'_>) -> f64 {
    environment.model.bus.full_v - environment.bus_voltage_v
}

impl Effect for SupplyVoltage {
    fn info(&self) -> &'static EffectInfo {
        &INFO
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        Voltage::specs(model)
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        let loss = Voltage::of(values).wheel_torque_per_v * drop_v(environment);
        for (j, torque) in torque_n_m.iter_mut().enumerate() {
            *torque -= loss * environment.available_motor_torque(j);
        }
    }

    fn valve_delay_s(&self, values: &[f64], environment: &Environment<'_>) -> (f64, f64) {
        (Voltage::of(values).valve_delay_s_v * drop_v(environment).max(0.0), 0.0)
    }

    fn evidence(&self) -> Evidence {
        &[&[Need::Wheels, Need::WheelCommands], &[Need::Jets]]
    }

    fn aids(&self) -> &'static [Aid] {
        &[Aid::BusVoltage]
    }
}
