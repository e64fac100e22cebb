//! Wheels in the model: momentum, energy and torque from what is measured and commanded.

use nalgebra::Vector3;

use super::MAX_WHEELS;
use super::dynamics::{friction_n_m, sign};
use crate::{Environment, Gyrostat};

impl Gyrostat {
    /// Total angular momentum about the centre of rotation, body axes [N m s] (eq. 4.9). Wheels
    /// without an entry in `wheel_speed_rad_s` count as stopped.
    #[must_use]
    pub fn momentum_b_n_m_s(
        &self,
        omega_wb_b_rad_s: &Vector3<f64>,
        wheel_speed_rad_s: &[f64],
    ) -> Vector3<f64> {
        let mut momentum = self.model().mass_properties.inertia_b_kg_m2() * omega_wb_b_rad_s;
        for (wheel, speed) in self.model().wheels().iter().zip(wheel_speed_rad_s) {
            momentum += wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * speed);
        }
        momentum
    }

    /// Kinetic energy of platform and wheels \[J\].
    #[must_use]
    pub fn kinetic_energy_j(&self, omega_wb_b_rad_s: &Vector3<f64>, wheel_speed_rad_s: &[f64]) -> f64 {
        let inertia = self.model().mass_properties.inertia_b_kg_m2();
        let mut twice = omega_wb_b_rad_s.dot(&(inertia * omega_wb_b_rad_s));
        for (wheel, speed) in self.model().wheels().iter().zip(wheel_speed_rad_s) {
            // J (a.w + Om)^2 - J (a.w)^2: the locked wheel is in I already.
            twice +=
                wheel.spin_inertia_kg_m2 * speed * (2.0 * wheel.spin_axis_b.dot(omega_wb_b_rad_s) + speed);
        }
        0.5 * twice
    }

    /// Torque on each wheel about its axis \[N m\]: motor, friction and effects; the body takes the
    /// opposite. A wheel at zero speed is given no Coulomb friction here.
    #[must_use]
    pub fn wheel_torque_n_m(&self, environment: &Environment<'_>) -> [f64; MAX_WHEELS] {
        let mut torque_n_m = [0.0; MAX_WHEELS];
        for (j, (torque, wheel)) in torque_n_m.iter_mut().zip(self.model().wheels()).enumerate() {
            let speed = environment.wheel_speed(j);
            *torque = environment.wheel_motor_torque(j) + friction_n_m(wheel, speed, sign(speed));
        }
        if let Some(torque_n_m) = torque_n_m.get_mut(..self.model().wheels().len()) {
            self.effects().add_wheel_torque_n_m(environment, torque_n_m);
        }
        torque_n_m
    }

    /// A u over the wheels that are not stuck, body axes [N m].
    #[must_use]
    pub fn on_wheels_b_n_m(
        &self,
        wheel_torque_n_m: &[f64; MAX_WHEELS],
        stuck: &[bool; MAX_WHEELS],
    ) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for ((wheel, torque), stuck) in self.model().wheels().iter().zip(wheel_torque_n_m).zip(stuck) {
            if !stuck {
                sum += wheel.spin_axis_b.into_inner() * *torque;
            }
        }
        sum
    }

    /// dOm/dt = u / J - A^T dw/dt of the wheels that are not stuck [rad/s^2].
    #[must_use]
    pub fn wheel_accelerations_rad_s2(
        &self,
        wheel_torque_n_m: &[f64; MAX_WHEELS],
        stuck: &[bool; MAX_WHEELS],
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> [f64; MAX_WHEELS] {
        let mut acceleration = [0.0; MAX_WHEELS];
        let wheels = self.model().wheels().iter().zip(wheel_torque_n_m).zip(stuck);
        for (slot, ((wheel, torque), stuck)) in acceleration.iter_mut().zip(wheels) {
            if !stuck {
                *slot = torque / wheel.spin_inertia_kg_m2 - wheel.spin_axis_b.dot(omega_dot_wb_b_rad_s2);
            }
        }
        acceleration
    }
}
