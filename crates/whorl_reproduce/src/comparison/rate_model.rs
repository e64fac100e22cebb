//! The equation of motion over a step, for filters that have the rate as a state.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::gyrostat::equation::gravity_torque_n_m;
use whorl_dynamics::gyrostat::{LinearisedRate, RateEquation};
use whorl_estimation::BodyModel;
use whorl_estimation::kernels::FilterStep;

/// A body with the wheels' momentum as measured, gravity and jets; a body without wheels is rigid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RateModel {
    pub(super) body: BodyModel,
    equation: RateEquation,
    wheel_momentum_b_n_m_s: Vector3<f64>,
}

impl RateModel {
    pub(super) fn new(body: &BodyModel, wheel_momentum_b_n_m_s: Vector3<f64>) -> Option<Self> {
        let equation = RateEquation::with_known_wheel_speeds(body.inertia_kg_m2)?;
        Some(Self { body: *body, equation, wheel_momentum_b_n_m_s })
    }

    /// Angular acceleration without the exchange with the wheels: `up_b` is the vertical in body axes.
    pub(super) fn acceleration(&self, omega: &Vector3<f64>, up_b: &Vector3<f64>) -> Vector3<f64> {
        let momentum = self.equation.momentum_b_n_m_s(omega, &self.wheel_momentum_b_n_m_s);
        let gravity = gravity_torque_n_m(&self.body.gravity_offset_b_n_m, up_b);
        self.equation.acceleration_b_rad_s2(omega, &momentum, &gravity, &Vector3::zeros())
    }

    /// Its derivatives.
    pub(super) fn linearised(&self, omega: &Vector3<f64>, up_b: &Vector3<f64>) -> LinearisedRate {
        let momentum = self.equation.momentum_b_n_m_s(omega, &self.wheel_momentum_b_n_m_s);
        self.equation.linearised(omega, &momentum, &self.body.gravity_offset_b_n_m, up_b)
    }

    /// Rate change by wheels and jets in a step.
    pub(super) fn exchange(&mut self, step: &FilterStep) -> Vector3<f64> {
        let wheels = step.wheel_momentum_b_n_m_s - self.wheel_momentum_b_n_m_s;
        self.wheel_momentum_b_n_m_s = step.wheel_momentum_b_n_m_s;
        self.equation.rate_change_b_rad_s(&(step.jet_impulse_b_n_m_s - wheels))
    }

    pub(super) fn wheel_momentum_b_n_m_s(&self) -> Vector3<f64> {
        self.wheel_momentum_b_n_m_s
    }

    /// Covariance that a step adds to the rate: unmodelled torques, taken as white over a second (these filters have
    /// no state for them), and two samples of the tachometers.
    pub(super) fn rate_noise(&self, step: &FilterStep) -> Matrix3<f64> {
        let body = &self.body;
        let torque = body.torque_noise_n_m_sqrt_hz.powi(2) + body.torque_sigma_n_m.powi(2);
        let jets = (step.jet_impulse_b_n_m_s * body.jet_relative_sigma).norm_squared();
        let variance = torque * step.dt_s + jets + 2.0 * body.wheel_momentum_noise_n_m_s.powi(2);
        let inverse = self.equation.inverse_resisting();
        inverse * inverse.transpose() * variance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_acceleration() {
        let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
        let body = BodyModel::new(inertia, Vector3::new(-0.02, -0.07, -2.0));
        let model = RateModel::new(&body, Vector3::new(0.3, -1.0, 2.0)).expect("regular");
        let (omega, up) = (Vector3::new(0.1, -0.4, 0.6), Vector3::new(0.1, -0.2, 0.97));
        let linear = model.linearised(&omega, &up);
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-6;
            let rate =
                (model.acceleration(&(omega + step), &up) - model.acceleration(&(omega - step), &up)) / 2e-6;
            let tilt =
                (model.acceleration(&omega, &(up + step)) - model.acceleration(&omega, &(up - step))) / 2e-6;
            assert!((rate - linear.by_rate.column(axis)).norm() < 1e-8);
            assert!((tilt - linear.by_vertical.column(axis)).norm() < 1e-8);
        }
    }

    #[test]
    fn a_free_body_keeps_its_momentum() {
        let inertia = Matrix3::from_diagonal(&Vector3::new(3.0, 2.0, 1.0));
        let model =
            RateModel::new(&BodyModel::new(inertia, Vector3::zeros()), Vector3::zeros()).expect("regular");
        let omega = Vector3::new(0.3, 0.5, -0.2);
        let acceleration = model.acceleration(&omega, &Vector3::z());
        // Energy and the length of the momentum stay: I a is across omega and across I omega.
        assert!(omega.dot(&(inertia * acceleration)).abs() < 1e-15);
        assert!((inertia * omega).dot(&(inertia * acceleration)).abs() < 1e-15);
    }
}
