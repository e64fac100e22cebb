//! The plant's wheels: commands and readings.

use super::MAX_WHEELS;
use crate::actuators::Kind;
use crate::plant::{CommandError, Plant};
use crate::sensing::WheelSample;
use crate::State;

impl State {
    /// Wheel speeds relative to the body [rad/s]; entries beyond the platform's own wheels are zero.
    #[must_use]
    pub fn wheel_speed_rad_s(&self) -> &[f64; MAX_WHEELS] {
        &self.actuators.wheels.speed_rad_s
    }

    /// Sets the wheels' speeds [rad/s]; wheels without an entry go on.
    pub(crate) fn set_wheel_speed_rad_s(&mut self, speed_rad_s: &[f64]) {
        for (slot, speed) in self.actuators.wheels.speed_rad_s.iter_mut().zip(speed_rad_s) {
            *slot = *speed;
        }
    }

    /// Sets one wheel's speed [rad/s].
    pub(crate) fn set_one_wheel_speed_rad_s(&mut self, wheel: usize, speed_rad_s: f64) {
        if let Some(slot) = self.actuators.wheels.speed_rad_s.get_mut(wheel) {
            *slot = speed_rad_s;
        }
    }
}

impl Plant {
    /// Sets the motor torques [N m], from now until the next command; each is limited to what its
    /// motor can give. Torque u on a wheel reacts as -u on the body.
    ///
    /// # Errors
    /// Wrong number of torques, or one that is not finite.
    pub fn command_wheels(&mut self, torque_n_m: &[f64]) -> Result<(), CommandError> {
        self.command_motors(Kind::Wheels, torque_n_m)
    }

    /// Reads the wheels' drives now, in the order of the model's wheels.
    pub fn sample_wheels(&mut self) -> Vec<WheelSample> {
        let sample = self.sample_joints(Kind::Wheels);
        let wheels = sample.velocity_rad_s.into_iter().zip(sample.effort_n_m);
        wheels
            .map(|(speed_rad_s, motor_torque_n_m)| WheelSample { speed_rad_s, motor_torque_n_m })
            .collect()
    }
}
