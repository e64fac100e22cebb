//! Feed-forward: torques on platform and wheels known from the model, which control compensates.

use nalgebra::Vector3;
use whorl_dynamics::Environment;
use whorl_dynamics::actuators::Kind;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::gyrostat::equation::gravity_torque_n_m;

use super::LocalControlCore;
use crate::inputs::Estimate;

impl LocalControlCore {
    pub(super) fn balancing_torque(&self, estimate: &Estimate) -> Vector3<f64> {
        self.balancing.as_ref().map_or_else(Vector3::zeros, |b| b.torque_b_n_m(estimate))
    }

    pub(super) fn modelled_torque(&self, estimate: &Estimate) -> Vector3<f64> {
        let model = self.gyrostat.model();
        let mut environment = Environment::new(model, estimate.q_world_body, estimate.omega_wb_b_rad_s);
        if !self.parameters.compensate_effects {
            let offset = model.mass_properties.gravity_offset_b_n_m();
            return gravity_torque_n_m(offset, &environment.vertical_b);
        }
        environment.wheel_speed_rad_s = self.inputs.wheel_speed_rad_s();
        self.set_supplies(&mut environment);
        self.gyrostat.modelled_torque_b_n_m(&environment, &[])
    }

    /// Gas and its pressure, by the model; bus voltage, where it is measured.
    fn set_supplies(&self, environment: &mut Environment<'_>) {
        let used_kg = self.actuation.gas_used_kg();
        environment.gas_used_kg = used_kg;
        environment.tank_pressure_pa = self.gyrostat.pressure_pa(self.gyrostat.initial_gas_kg() - used_kg);
        if let Some(volt) = self.inputs.bus_voltage_v() {
            environment.bus_voltage_v = volt;
        }
    }

    /// Torque of the model's effects on each wheel besides bearing friction, for the motors to counter \[N m\].
    pub(super) fn wheel_effects_n_m(&self, estimate: &Estimate) -> [f64; MAX_WHEELS] {
        let mut torque_n_m = [0.0; MAX_WHEELS];
        if self.parameters.compensate_effects {
            let model = self.gyrostat.model();
            let mut environment = Environment::new(model, estimate.q_world_body, estimate.omega_wb_b_rad_s);
            environment.wheel_speed_rad_s = self.inputs.wheel_speed_rad_s();
            environment.wheel_motor_torque_n_m = self.actuation.commands(Kind::Wheels as usize);
            self.set_supplies(&mut environment);
            if let Some(wheels) = torque_n_m.get_mut(..model.wheels().len()) {
                self.gyrostat.effects().add_wheel_torque_n_m(&environment, wheels);
            }
        }
        torque_n_m
    }
}
