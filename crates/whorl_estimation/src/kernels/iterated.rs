//! Iterated extended Kalman filter: attitude error and gyro bias, measurement relinearised at each new estimate.
//!
//! B. M. Bell, F. W. Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE Transactions on
//! Automatic Control 38(2), 1993. The error of section 4.5.4 in body axes, `R_true = R exp(a)`, and the direction
//! itself as measurement, `y = R^T r` (eq. 4.71), whose sensitivity is `[y x]` (eq. 4.72 at a = 0).

use super::bias_state::{BiasState, GyroNoise, transformed};
use super::kernel::{DirectionMeasurement, FilterStep, Kernel, Solution, Update};
use crate::parameters::Parameters;
use nalgebra::{Matrix3, Matrix6, SMatrix, Unit, UnitQuaternion, Vector3, Vector6};
use whorl_math::covariance::{correct, propagate};
use whorl_math::{quaternion_exp, skew};

/// Gauss-Newton steps at most.
const ITERATIONS: usize = 10;
/// A smaller correction ends the iteration \[rad\].
const CONVERGED_RAD: f64 = 1e-10;

/// The filter's state.
#[derive(Clone, Debug, PartialEq)]
pub struct IteratedFilter {
    state: BiasState,
    noise: GyroNoise,
    /// Attitude error in body axes, bias error.
    covariance: Matrix6<f64>,
}

impl IteratedFilter {
    /// A filter that goes on from an estimate.
    #[must_use]
    pub fn new(parameters: &Parameters, start: &Solution) -> Self {
        Self { state: BiasState::new(start), noise: GyroNoise::new(parameters), covariance: start.covariance }
    }
}

impl Kernel for IteratedFilter {
    fn step(&mut self, step: &FilterStep) -> Update {
        let (before, after) = self.state.advance(step);
        let mean = (before + after) * 0.5;
        // In world axes the error does not turn; there and back is the body-axis transition.
        let mut p = transformed(&self.covariance, &before, &Matrix3::identity());
        let mut f = Matrix6::identity();
        f.fixed_view_mut::<3, 3>(0, 3).copy_from(&(mean * -step.dt_s));
        propagate(&mut p, &f, &self.noise.of_step(step.dt_s, &mean));
        self.covariance = transformed(&p, &after.transpose(), &Matrix3::identity());
        Update::default()
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        let prior = self.state.clone();
        let mut error = Vector6::zeros();
        let mut result: Option<(f64, _, _, _)> = None;
        for _ in 0..ITERATIONS {
            let (z, h) =
                linearised(&prior.q_world_body, &error, &measured.direction_b, &measured.reference_w);
            let a = self.covariance * h.transpose();
            let s = h * a + Matrix3::identity() * measured.variance;
            let Some(factor) = s.cholesky() else { return Update::default() };
            let gain = factor.solve(&a.transpose()).transpose();
            // Gauss-Newton: the innovation is carried back to the prior's error, zero.
            let next = gain * (z + h * error);
            let change = (next - error).fixed_rows::<3>(0).norm();
            error = next;
            // How well the innovation agreed is that of the first linearisation.
            let nis = result.map_or_else(|| z.dot(&factor.solve(&z)), |(nis, ..)| nis);
            result = Some((nis, gain, a, s));
            if change < CONVERGED_RAD {
                break;
            }
        }
        let Some((nis, gain, a, s)) = result else { return Update::default() };
        correct(&mut self.covariance, &gain, &a, &s);
        let turn = Vector3::from(error.fixed_rows::<3>(0));
        self.state.q_world_body = prior.q_world_body * quaternion_exp(&turn);
        self.state.q_world_body.renormalize_fast();
        self.state.bias_rad_s += error.fixed_rows::<3>(3);
        // The error is now counted from the new estimate.
        let reset = whorl_math::right_jacobian(&turn);
        self.covariance = transformed(&self.covariance, &reset, &Matrix3::identity());
        Update { nis, dof: 2 }
    }

    fn solution(&self) -> Solution {
        self.state.solution(self.covariance)
    }
}

/// Innovation and sensitivity of `y = exp(a)^T R^T r` at an error `a`.
fn linearised(
    q_prior: &UnitQuaternion<f64>,
    error: &Vector6<f64>,
    direction_b: &Unit<Vector3<f64>>,
    reference_w: &Unit<Vector3<f64>>,
) -> (Vector3<f64>, SMatrix<f64, 3, 6>) {
    let a = Vector3::from(error.fixed_rows::<3>(0));
    let q = q_prior * quaternion_exp(&a);
    let predicted = q.inverse() * reference_w.into_inner();
    let mut h = SMatrix::<f64, 3, 6>::zeros();
    let along = skew(&predicted) * whorl_math::right_jacobian(&a);
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&along);
    (direction_b.into_inner() - predicted, h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensitivity_is_the_derivative() {
        let q = UnitQuaternion::from_euler_angles(0.4, -0.8, 2.0);
        let reference = Unit::new_normalize(Vector3::new(0.3, -0.5, 0.8));
        let measured = Unit::new_normalize(Vector3::new(0.1, 0.2, 0.9));
        for a in [Vector3::zeros(), Vector3::new(0.5, -0.3, 0.9)] {
            let mut error = Vector6::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&a);
            let (_, h) = linearised(&q, &error, &measured, &reference);
            for axis in 0..6 {
                let mut step = Vector6::zeros();
                step[axis] = 1e-6;
                let plus = linearised(&q, &(error + step), &measured, &reference).0;
                let minus = linearised(&q, &(error - step), &measured, &reference).0;
                // The innovation falls as the prediction rises.
                let numeric = (minus - plus) / 2e-6;
                assert!((numeric - h.column(axis)).norm() < 1e-8, "axis {axis}");
            }
        }
    }
}
