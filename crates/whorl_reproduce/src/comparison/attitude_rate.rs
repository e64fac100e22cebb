//! Attitude-error / angular-velocity filter of section 4.5.3 (eqs. 4.61-4.68), for a rigid body or a gyrostat.
//!
//! The error is a rotation vector in body axes, `R_true = R exp(a)`, equal to the dissertation's Gibbs vector to second
//! order and reset to zero after each update; the rate is a state and the gyro a measurement. The gyro's bias is taken as known
//! from the start, as in the dissertation: what it drifts later goes into the rate.

use super::rate_state::RateState;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use whorl_estimation::kernels::{
    DirectionMeasurement, FilterStep, Kernel, KernelStart, Solution, Update, correct_three_components,
};
use whorl_math::covariance::propagate;
use whorl_math::{quaternion_exp, skew};

/// The filter's state.
#[derive(Clone, Debug, PartialEq)]
pub struct AttitudeRateFilter {
    state: RateState,
    /// Attitude error, rate error; body axes.
    covariance: Matrix6<f64>,
}

impl AttitudeRateFilter {
    /// A filter that goes on from an estimate; `None` without a body, or if its inertia is singular.
    #[must_use]
    pub fn new(start: &KernelStart<'_>) -> Option<Self> {
        let (state, rate) = RateState::new(start)?;
        let mut covariance = start.solution.covariance;
        covariance.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
        covariance.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&rate);
        Some(Self { state, covariance })
    }

    fn apply(&mut self, correction: &Vector6<f64>) {
        self.state.q_world_body *= quaternion_exp(&Vector3::from(correction.fixed_rows::<3>(0)));
        self.state.q_world_body.renormalize_fast();
        self.state.omega_rad_s += correction.fixed_rows::<3>(3);
    }

    /// Moves the mean by a step and gives the error's transition, to second order in the attitude.
    fn predict(&mut self, step: &FilterStep) -> Matrix6<f64> {
        let dt_s = step.dt_s;
        let up_b = self.state.q_world_body.inverse() * Vector3::z();
        let first = self.state.model.acceleration(&self.state.omega_rad_s, &up_b);
        let half = self.state.omega_rad_s + first * (0.5 * dt_s);
        let middle = self.state.q_world_body * quaternion_exp(&(self.state.omega_rad_s * (0.5 * dt_s)));
        let up_b = middle.inverse() * Vector3::z();
        let acceleration = self.state.model.acceleration(&half, &up_b);
        let rate = self.state.model.linearised(&half, &up_b);
        let (turn, mean_rate) = self.state.advance(step, &acceleration);
        let back = *turn.inverse().to_rotation_matrix().matrix();
        let mut f = Matrix6::identity();
        f.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        f.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(Matrix3::identity() * dt_s - skew(&mean_rate) * (0.5 * dt_s * dt_s)));
        f.fixed_view_mut::<3, 3>(3, 0).copy_from(&(rate.by_attitude * dt_s));
        f.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() + rate.by_rate * dt_s));
        f
    }
}

impl Kernel for AttitudeRateFilter {
    fn step(&mut self, step: &FilterStep) -> Update {
        let rate_noise = self.state.model.rate_noise(step);
        let f = self.predict(step);
        let mut q = Matrix6::zeros();
        q.fixed_view_mut::<3, 3>(0, 0).copy_from(&(rate_noise * (step.dt_s * step.dt_s / 3.0)));
        q.fixed_view_mut::<3, 3>(0, 3).copy_from(&(rate_noise * (0.5 * step.dt_s)));
        q.fixed_view_mut::<3, 3>(3, 0).copy_from(&(rate_noise * (0.5 * step.dt_s)));
        q.fixed_view_mut::<3, 3>(3, 3).copy_from(&rate_noise);
        propagate(&mut self.covariance, &f, &q);
        let (correction, update) = self.state.use_gyro(&mut self.covariance, 3, step);
        self.apply(&correction);
        update
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        let predicted = self.state.q_world_body.inverse() * measured.reference_w.into_inner();
        let mut h = SMatrix::<f64, 3, 6>::zeros();
        h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(&predicted));
        let innovation = measured.direction_b.into_inner() - predicted;
        let (correction, update) =
            correct_three_components(&mut self.covariance, &h, measured.variance, &innovation, 2);
        self.apply(&correction);
        update
    }

    fn solution(&self) -> Solution {
        self.state.solution(&self.covariance.fixed_view::<3, 3>(0, 0).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use whorl_estimation::{BodyModel, Parameters};
    use whorl_math::rotation_vector;

    #[test]
    fn transition_is_the_derivative_of_the_motion() {
        let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
        let body = BodyModel::new(inertia, Vector3::new(-0.4, 0.7, -2.0));
        let start = Solution {
            q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0),
            omega_rad_s: Vector3::new(0.2, -0.3, 0.5),
            gyro_bias_rad_s: Vector3::zeros(),
            covariance: Matrix6::identity() * 1e-4,
            wheel_momentum_b_n_m_s: Vector3::new(0.5, -1.0, 0.3),
        };
        let step = FilterStep {
            dt_s: 1e-2,
            gyro_rad_s: start.omega_rad_s,
            gyro_before_rad_s: start.omega_rad_s,
            force_b_m_s2: None,
            wheel_momentum_b_n_m_s: start.wheel_momentum_b_n_m_s,
            jet_impulse_b_n_m_s: Vector3::zeros(),
        };
        let parameters = Parameters::motion_pak_ii();
        let start = KernelStart { parameters: &parameters, body: Some(&body), solution: &start };
        let reference = AttitudeRateFilter::new(&start).expect("regular");
        let mut moved = reference.clone();
        let f = moved.predict(&step);
        for state in 0..6 {
            let mut error = Vector6::zeros();
            error[state] = 1e-5;
            let mut other = reference.clone();
            other.apply(&error);
            other.predict(&step);
            let attitude =
                rotation_vector(&(moved.state.q_world_body.inverse() * other.state.q_world_body)) / 1e-5;
            let rate = (other.state.omega_rad_s - moved.state.omega_rad_s) / 1e-5;
            // Second order in the step: 1e-4 times coefficients of order one.
            assert!((attitude - f.fixed_view::<3, 1>(0, state)).norm() < 2e-4, "attitude, state {state}");
            assert!((rate - f.fixed_view::<3, 1>(3, state)).norm() < 2e-4, "rate, state {state}");
        }
    }
}
