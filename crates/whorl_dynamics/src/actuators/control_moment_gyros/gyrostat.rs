//! Gyros in the model, from the measured motion of their gimbals.
//!
//! With gimbal angle, rate and acceleration known, a gyro is a known momentum in the equation of motion and its known rate:
//! h0 s + J_g dgamma/dt g, and h0 dgamma/dt t + J_g d2gamma/dt2 g. Its gimbal's inertia then resists with the body's.

use nalgebra::Vector3;

use crate::{Environment, Gyrostat};

impl Gyrostat {
    /// Momentum of the gyros relative to the body at the measured gimbal angles and rates, body axes [N m s].
    #[must_use]
    pub fn gyro_momentum_b_n_m_s(&self, environment: &Environment<'_>) -> Vector3<f64> {
        let of = |(j, gyro): (usize, &super::Gyro)| {
            gyro.axes_b(environment.gimbal_angle(j)).0 * gyro.rotor_momentum_n_m_s
                + gyro.gimbal_axis_b.into_inner() * (gyro.gimbal_inertia_kg_m2 * environment.gimbal_rate(j))
        };
        self.model().gyros().iter().enumerate().map(of).sum()
    }

    /// Rate of that momentum relative to the body, the torque with which the body turns the gyros, body axes [N m].
    #[must_use]
    pub fn on_gyros_b_n_m(&self, environment: &Environment<'_>) -> Vector3<f64> {
        let of = |(j, gyro): (usize, &super::Gyro)| {
            let across = gyro.axes_b(environment.gimbal_angle(j)).1;
            across * (gyro.rotor_momentum_n_m_s * environment.gimbal_rate(j))
                + gyro.gimbal_axis_b.into_inner()
                    * (gyro.gimbal_inertia_kg_m2 * environment.gimbal_acceleration(j))
        };
        self.model().gyros().iter().enumerate().map(of).sum()
    }
}
