//! Common to the filters that have attitude and rate as states: the mean, the start, the gyro as a measurement.

use super::rate_model::RateModel;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, UnitQuaternion, Vector3};
use whorl_estimation::kernels::{FilterStep, KernelStart, Solution, Update, correct_three_components};
use whorl_math::quaternion_exp;

/// Attitude and rate, with the equation of motion, and the gyro's bias as it was known at the start.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RateState {
    pub(super) model: RateModel,
    pub(super) q_world_body: UnitQuaternion<f64>,
    pub(super) omega_rad_s: Vector3<f64>,
    gyro_bias_rad_s: Vector3<f64>,
    gyro_noise_density: f64,
    bias_covariance: Matrix3<f64>,
}

impl RateState {
    /// Goes on from an estimate; beside it the covariance of the rate. `None` without a body, or if its inertia is
    /// singular.
    pub(super) fn new(start: &KernelStart<'_>) -> Option<(Self, Matrix3<f64>)> {
        let (parameters, body, start) = (start.parameters, start.body?, start.solution);
        let state = Self {
            model: RateModel::new(body, start.wheel_momentum_b_n_m_s)?,
            q_world_body: start.q_world_body,
            omega_rad_s: start.omega_rad_s,
            gyro_bias_rad_s: start.gyro_bias_rad_s,
            gyro_noise_density: parameters.gyro_noise_rad_s_sqrt_hz.powi(2),
            bias_covariance: start.covariance.fixed_view::<3, 3>(3, 3).into(),
        };
        Some((state, Matrix3::identity() * body.rate_sigma_rad_s.powi(2)))
    }

    /// Moves attitude and rate by a step with this angular acceleration: the rotation, and the mean rate.
    pub(super) fn advance(
        &mut self,
        step: &FilterStep,
        acceleration_b_rad_s2: &Vector3<f64>,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        // Half of the impulse of wheels and jets acts within the step.
        let exchange = self.model.exchange(step);
        let mean_rate = self.omega_rad_s + (acceleration_b_rad_s2 * step.dt_s + exchange) * 0.5;
        let turn = quaternion_exp(&(mean_rate * step.dt_s));
        self.q_world_body *= turn;
        self.q_world_body.renormalize_fast();
        self.omega_rad_s += acceleration_b_rad_s2 * step.dt_s + exchange;
        (turn, mean_rate)
    }

    /// Correction by the gyro, the rate beginning at this place of the state.
    pub(super) fn use_gyro<const N: usize>(
        &self,
        covariance: &mut SMatrix<f64, N, N>,
        rate_at: usize,
        step: &FilterStep,
    ) -> (SVector<f64, N>, Update) {
        let mut h = SMatrix::<f64, 3, N>::zeros();
        h.fixed_view_mut::<3, 3>(0, rate_at).copy_from(&Matrix3::identity());
        let innovation = step.gyro_rad_s - self.gyro_bias_rad_s - self.omega_rad_s;
        correct_three_components(covariance, &h, self.gyro_noise_density / step.dt_s, &innovation, 3)
    }

    /// The estimate with this covariance of the attitude error in body axes.
    pub(super) fn solution(&self, attitude: &Matrix3<f64>) -> Solution {
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(attitude);
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.bias_covariance);
        Solution {
            q_world_body: self.q_world_body,
            omega_rad_s: self.omega_rad_s,
            gyro_bias_rad_s: self.gyro_bias_rad_s,
            covariance,
            wheel_momentum_b_n_m_s: self.model.wheel_momentum_b_n_m_s(),
        }
    }
}
