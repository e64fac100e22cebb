//! Motor commands by the name of their field.

use crate::whorl::ActuatorCommand;

impl ActuatorCommand {
    /// The commands in the field of this name; `None` when no field of that name holds motor commands.
    #[must_use]
    pub fn motor_commands(&self, field: &str) -> Option<&[f64]> {
        match field {
            "wheel_torque_n_m" => Some(&self.wheel_torque_n_m),
            "gimbal_rate_rad_s" => Some(&self.gimbal_rate_rad_s),
            _ => None,
        }
    }

    /// The commands in the field of this name, to be filled.
    pub fn motor_commands_mut(&mut self, field: &str) -> Option<&mut Vec<f64>> {
        match field {
            "wheel_torque_n_m" => Some(&mut self.wheel_torque_n_m),
            "gimbal_rate_rad_s" => Some(&mut self.gimbal_rate_rad_s),
            _ => None,
        }
    }
}
