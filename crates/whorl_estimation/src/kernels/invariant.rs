//! Equivariant filter with gyro bias.
//!
//! A. Fornasier, Y. Ng, R. Mahony, S. Weiss, "Equivariant filter design for inertial navigation systems with input
//! measurement biases" and "Overcoming bias: equivariant filter design for biased attitude estimation with online
//! calibration", 2022: attitude and bias together are acted on by the tangent group of SO(3). In its coordinates both
//! errors are in world axes, `R_true = exp(delta) R` and `beta = R (b_true - b)`, and their dynamics
//!
//! `delta' = -beta`, `beta' = (R omega) x beta`
//!
//! depend on the estimate only through the measured rate. The output is linearised at the mean of measurement and
//! prediction, which makes its error of third order; the correction goes through the group's exponential.

use super::bias_state::{BiasState, GyroNoise, transformed};
use super::kernel::{DirectionMeasurement, FilterStep, Kernel, Solution, Update, correct_three_components};
use crate::parameters::Parameters;
use nalgebra::{Matrix3, Matrix6, SMatrix, Unit, Vector3, Vector6};
use whorl_math::covariance::propagate;
use whorl_math::{quaternion_exp, right_jacobian, skew};

/// The filter's state.
#[derive(Clone, Debug, PartialEq)]
pub struct InvariantFilter {
    state: BiasState,
    noise: GyroNoise,
    /// Attitude error and bias error, both in world axes.
    covariance: Matrix6<f64>,
}

impl InvariantFilter {
    /// A filter that goes on from an estimate.
    #[must_use]
    pub fn new(parameters: &Parameters, start: &Solution) -> Self {
        let state = BiasState::new(start);
        let rotation = state.rotation();
        Self {
            covariance: transformed(&start.covariance, &rotation, &rotation),
            state,
            noise: GyroNoise::new(parameters),
        }
    }
}

impl Kernel for InvariantFilter {
    fn step(&mut self, step: &FilterStep) -> Update {
        let (before, after) = self.state.advance(step);
        let mean = (before + after) * 0.5;
        // beta turns with the body: exp((R omega) dt) = after before^T; delta gains its integral.
        let turned = after * before.transpose();
        let mut f = Matrix6::identity();
        f.fixed_view_mut::<3, 3>(0, 3).copy_from(&(mean * before.transpose() * -step.dt_s));
        f.fixed_view_mut::<3, 3>(3, 3).copy_from(&turned);
        let body = self.noise.of_step(step.dt_s, &mean);
        let noise = transformed(&body, &Matrix3::identity(), &after);
        propagate(&mut self.covariance, &f, &noise);
        Update::default()
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        let rotation = self.state.rotation();
        let measured_w = rotation * measured.direction_b.into_inner();
        let h = sensitivity(&measured_w, &measured.reference_w);
        let innovation = measured_w - measured.reference_w.into_inner();
        let (correction, update) =
            correct_three_components(&mut self.covariance, &h, measured.variance, &innovation, 2);
        self.apply(&correction, &rotation);
        update
    }

    fn solution(&self) -> Solution {
        let back = self.state.rotation().transpose();
        self.state.solution(transformed(&self.covariance, &back, &back))
    }
}

impl InvariantFilter {
    /// The group's exponential: the bias part goes through the left Jacobian of the rotation, J_l(d) = J_r(-d).
    fn apply(&mut self, correction: &Vector6<f64>, rotation: &Matrix3<f64>) {
        let turn = Vector3::from(correction.fixed_rows::<3>(0));
        let bias_w = right_jacobian(&-turn) * correction.fixed_rows::<3>(3);
        self.state.bias_rad_s += rotation.tr_mul(&bias_w);
        self.state.q_world_body = quaternion_exp(&turn) * self.state.q_world_body;
        self.state.q_world_body.renormalize_fast();
    }
}

/// `R y = exp(-delta) r`: to third order, the innovation is `(R y + r)/2 x delta`.
fn sensitivity(measured_w: &Vector3<f64>, reference_w: &Unit<Vector3<f64>>) -> SMatrix<f64, 3, 6> {
    let mut h = SMatrix::<f64, 3, 6>::zeros();
    let mean = (measured_w + reference_w.into_inner()) * 0.5;
    h.fixed_view_mut::<3, 3>(0, 0).copy_from(&skew(&mean));
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_is_linear_to_third_order() {
        let reference = Unit::new_normalize(Vector3::new(0.3, -0.5, 0.8));
        let axis = Vector3::new(0.7, 0.1, -0.4);
        let residual = |angle: f64| {
            let delta = axis * angle;
            let measured_w = quaternion_exp(&-delta) * reference.into_inner();
            let predicted = sensitivity(&measured_w, &reference).fixed_view::<3, 3>(0, 0) * delta;
            (measured_w - reference.into_inner() - predicted).norm()
        };
        assert!(residual(0.01) < 1e-6);
        // Halving the angle divides a third-order error by eight, a second-order one by four.
        let order = (residual(0.2) / residual(0.1)).log2();
        assert!(order > 2.8, "{order}");
    }
}
