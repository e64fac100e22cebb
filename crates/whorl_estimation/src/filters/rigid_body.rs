//! The gyrostat's rate equation, for filters that have the rate as a state.

use super::FilterStep;
use crate::body::BodyModel;
use nalgebra::{Matrix3, Vector3};
use whorl_math::skew;

/// Euler's equation with wheels, gravity and jets (eqs. 4.8-4.14); a body without wheels is rigid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RateModel {
    pub(super) body: BodyModel,
    inverse_inertia: Matrix3<f64>,
    wheel_momentum_b_n_m_s: Vector3<f64>,
}

impl RateModel {
    pub(super) fn new(body: &BodyModel, wheel_momentum_b_n_m_s: Vector3<f64>) -> Option<Self> {
        let inverse_inertia = body.inertia_kg_m2.try_inverse()?;
        Some(Self { body: *body, inverse_inertia, wheel_momentum_b_n_m_s })
    }

    /// Angular acceleration without what the wheels exchange: `up_b` is the vertical in body axes.
    pub(super) fn acceleration(&self, omega: &Vector3<f64>, up_b: &Vector3<f64>) -> Vector3<f64> {
        let momentum = self.body.inertia_kg_m2 * omega + self.wheel_momentum_b_n_m_s;
        self.inverse_inertia * (momentum.cross(omega) - self.body.gravity_offset_b_n_m.cross(up_b))
    }

    /// Its derivatives by the rate and by the vertical.
    pub(super) fn derivatives(&self, omega: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
        let inertia = &self.body.inertia_kg_m2;
        let momentum = inertia * omega + self.wheel_momentum_b_n_m_s;
        let by_rate = self.inverse_inertia * (skew(&momentum) - skew(omega) * inertia);
        (by_rate, self.inverse_inertia * -skew(&self.body.gravity_offset_b_n_m))
    }

    /// Rate change by what wheels and jets did in a step.
    pub(super) fn exchange(&mut self, step: &FilterStep) -> Vector3<f64> {
        let wheels = step.wheel_momentum_b_n_m_s - self.wheel_momentum_b_n_m_s;
        self.wheel_momentum_b_n_m_s = step.wheel_momentum_b_n_m_s;
        self.inverse_inertia * (step.jet_impulse_b_n_m_s - wheels)
    }

    pub(super) fn wheel_momentum_b_n_m_s(&self) -> Vector3<f64> {
        self.wheel_momentum_b_n_m_s
    }

    /// Covariance that a step adds to the rate: torques that the model lacks, taken as white over a second (these filters have
    /// no state for them), and two samples of the tachometers.
    pub(super) fn rate_noise(&self, step: &FilterStep) -> Matrix3<f64> {
        let body = &self.body;
        let torque = body.torque_noise_n_m_sqrt_hz.powi(2) + body.torque_sigma_n_m.powi(2);
        let jets = (step.jet_impulse_b_n_m_s * body.jet_relative_sigma).norm_squared();
        let variance = torque * step.dt_s + jets + 2.0 * body.wheel_momentum_noise_n_m_s.powi(2);
        self.inverse_inertia * self.inverse_inertia.transpose() * variance
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
        let (by_rate, by_up) = model.derivatives(&omega);
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-6;
            let rate =
                (model.acceleration(&(omega + step), &up) - model.acceleration(&(omega - step), &up)) / 2e-6;
            let tilt =
                (model.acceleration(&omega, &(up + step)) - model.acceleration(&omega, &(up - step))) / 2e-6;
            assert!((rate - by_rate.column(axis)).norm() < 1e-8);
            assert!((tilt - by_up.column(axis)).norm() < 1e-8);
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
