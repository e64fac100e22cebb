//! Common to the filters with attitude and gyro bias: the mean, and the conversion of covariances.

use super::kernel::{FilterStep, Solution};
use crate::parameters::Parameters;
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3};
use whorl_math::quaternion_exp;

/// Attitude, bias and the latest rate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BiasState {
    pub(super) q_world_body: UnitQuaternion<f64>,
    pub(super) bias_rad_s: Vector3<f64>,
    pub(super) gyro_rad_s: Vector3<f64>,
}

impl BiasState {
    pub(super) fn new(start: &Solution) -> Self {
        Self {
            q_world_body: start.q_world_body,
            bias_rad_s: start.gyro_bias_rad_s,
            gyro_rad_s: start.omega_rad_s + start.gyro_bias_rad_s,
        }
    }

    /// Turns by the mean rate of a step; the rotation matrices before and after, whose mean is that of the step.
    pub(super) fn advance(&mut self, step: &FilterStep) -> (Matrix3<f64>, Matrix3<f64>) {
        let before = self.rotation();
        let turn = mean_turn(&self.bias_rad_s, step);
        self.q_world_body *= quaternion_exp(&turn);
        self.q_world_body.renormalize_fast();
        self.gyro_rad_s = step.gyro_rad_s;
        (before, self.rotation())
    }

    pub(super) fn rotation(&self) -> Matrix3<f64> {
        *self.q_world_body.to_rotation_matrix().matrix()
    }

    /// The estimate with a covariance of body-axis errors.
    pub(super) fn solution(&self, covariance: Matrix6<f64>) -> Solution {
        Solution {
            q_world_body: self.q_world_body,
            omega_rad_s: self.gyro_rad_s - self.bias_rad_s,
            gyro_bias_rad_s: self.bias_rad_s,
            covariance: (covariance + covariance.transpose()) * 0.5,
            wheel_momentum_b_n_m_s: Vector3::zeros(),
        }
    }
}

/// Rotation of a step with a gyro sampled at its ends: the mean, and the first term of the Magnus series.
pub(super) fn mean_turn(bias_rad_s: &Vector3<f64>, step: &FilterStep) -> Vector3<f64> {
    let (before, after) = (step.gyro_before_rad_s - bias_rad_s, step.gyro_rad_s - bias_rad_s);
    (before + after) * (0.5 * step.dt_s) + before.cross(&after) * (step.dt_s * step.dt_s / 12.0)
}

/// Block-diagonal transformation of a covariance: attitude rows by `attitude`, bias rows by `bias`.
pub(super) fn transformed(p: &Matrix6<f64>, attitude: &Matrix3<f64>, bias: &Matrix3<f64>) -> Matrix6<f64> {
    let mut t = Matrix6::zeros();
    t.fixed_view_mut::<3, 3>(0, 0).copy_from(attitude);
    t.fixed_view_mut::<3, 3>(3, 3).copy_from(bias);
    t * p * t.transpose()
}

/// Densities of the gyro's white noise and of its bias walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GyroNoise {
    white: f64,
    walk: f64,
}

impl GyroNoise {
    pub(super) fn new(parameters: &Parameters) -> Self {
        Self {
            white: parameters.gyro_noise_rad_s_sqrt_hz.powi(2),
            walk: parameters.gyro_bias_walk_rad_s2_sqrt_hz.powi(2),
        }
    }

    /// What a step adds in world axes, with its mean rotation.
    pub(super) fn of_step(&self, dt_s: f64, mean_rotation: &Matrix3<f64>) -> Matrix6<f64> {
        let mut q = Matrix6::identity() * (self.walk * dt_s);
        let attitude = self.white * dt_s + self.walk * dt_s.powi(3) / 3.0;
        q.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * attitude));
        let cross = mean_rotation * (-0.5 * self.walk * dt_s * dt_s);
        q.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        q.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        q
    }

    /// Half of it in body axes: added before and after a propagation it is exact to second order (eq. 42 of Crassidis
    /// and Markley).
    pub(super) fn of_half_step(&self, dt_s: f64) -> Matrix6<f64> {
        let attitude = 0.5 * dt_s * (self.white - self.walk * dt_s * dt_s / 6.0).max(0.0);
        let mut noise = Matrix6::identity() * (0.5 * self.walk * dt_s);
        noise.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * attitude));
        noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant rate is integrated with the gyro bias removed.
    #[test]
    fn the_mean_turn_takes_off_the_bias() {
        let step = FilterStep {
            dt_s: 0.01,
            gyro_rad_s: Vector3::zeros(),
            gyro_before_rad_s: Vector3::zeros(),
            force_b_m_s2: None,
            wheel_momentum_b_n_m_s: Vector3::zeros(),
            jet_impulse_b_n_m_s: Vector3::zeros(),
        };
        assert_eq!(mean_turn(&Vector3::x(), &step), Vector3::x() * -0.01);
    }
}
