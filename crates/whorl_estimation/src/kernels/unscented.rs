//! Unscented quaternion estimator (USQUE).
//!
//! J. L. Crassidis, F. L. Markley, "Unscented filtering for spacecraft attitude estimation", Journal of Guidance,
//! Control, and Dynamics 26(4), 2003. The attitude error is a generalised Rodrigues parameter with a = 1, f = 4 (four
//! times the modified Rodrigues parameter), in body axes; the error quaternion of each sigma point multiplies the mean.

use super::bias_state::{BiasState, GyroNoise, mean_turn};
use super::kernel::{DirectionMeasurement, FilterStep, Kernel, Solution, Update};
use crate::parameters::Parameters;
use nalgebra::{Matrix3, Matrix6, Quaternion, SMatrix, UnitQuaternion, Vector3, Vector6};
use whorl_math::covariance::correct;
use whorl_math::quaternion_exp;

const POINTS: usize = 13;
/// Spread of the sigma points; the paper's value.
const LAMBDA: f64 = 1.0;
const STATES: f64 = 6.0;

/// The filter's state.
#[derive(Clone, Debug, PartialEq)]
pub struct UnscentedFilter {
    state: BiasState,
    noise: GyroNoise,
    /// Attitude error in body axes, bias error.
    covariance: Matrix6<f64>,
}

/// Four times the modified Rodrigues parameter of a small rotation; the shorter way.
fn rodrigues(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    Vector3::new(q.i, q.j, q.k) * (4.0 * sign / (1.0 + q.w.abs()))
}

fn from_rodrigues(p: &Vector3<f64>) -> UnitQuaternion<f64> {
    let sigma = p / 4.0;
    let squared = sigma.norm_squared();
    let v = sigma * (2.0 / (1.0 + squared));
    UnitQuaternion::new_unchecked(Quaternion::new((1.0 - squared) / (1.0 + squared), v.x, v.y, v.z))
}

fn weight(point: usize) -> f64 {
    if point == 0 { LAMBDA / (STATES + LAMBDA) } else { 0.5 / (STATES + LAMBDA) }
}

impl UnscentedFilter {
    /// A filter that goes on from an estimate.
    #[must_use]
    pub fn new(parameters: &Parameters, start: &Solution) -> Self {
        Self { state: BiasState::new(start), noise: GyroNoise::new(parameters), covariance: start.covariance }
    }

    /// Errors of the sigma points; `None` if the covariance is not positive definite.
    fn points(&self) -> Option<[Vector6<f64>; POINTS]> {
        let root = (self.covariance * (STATES + LAMBDA)).cholesky()?.l();
        let mut points = [Vector6::zeros(); POINTS];
        for axis in 0..6 {
            points[1 + axis] = root.column(axis).into_owned();
            points[7 + axis] = -root.column(axis);
        }
        Some(points)
    }

    fn point(&self, error: &Vector6<f64>) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let attitude = from_rodrigues(&Vector3::from(error.fixed_rows::<3>(0)));
        (self.state.q_world_body * attitude, self.state.bias_rad_s + error.fixed_rows::<3>(3))
    }
}

impl Kernel for UnscentedFilter {
    fn step(&mut self, step: &FilterStep) -> Update {
        self.covariance += self.noise.of_half_step(step.dt_s);
        self.state.gyro_rad_s = step.gyro_rad_s;
        let Some(points) = self.points() else { return Update::default() };
        let moved = points.map(|error| {
            let (q, bias) = self.point(&error);
            (q * quaternion_exp(&mean_turn(&bias, step)), bias)
        });
        let [(centre, centre_bias), ..] = moved;
        let errors = moved.map(|(q, bias)| {
            let mut error = Vector6::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&rodrigues(&(centre.inverse() * q)));
            error.fixed_rows_mut::<3>(3).copy_from(&(bias - centre_bias));
            error
        });
        let mean: Vector6<f64> = errors.iter().enumerate().map(|(i, e)| e * weight(i)).sum();
        self.covariance =
            errors.iter().enumerate().map(|(i, e)| (e - mean) * (e - mean).transpose() * weight(i)).sum();
        self.state.q_world_body = centre * from_rodrigues(&Vector3::from(mean.fixed_rows::<3>(0)));
        self.state.q_world_body.renormalize_fast();
        self.state.bias_rad_s = centre_bias + mean.fixed_rows::<3>(3);
        self.covariance += self.noise.of_half_step(step.dt_s);
        Update::default()
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        let Some(points) = self.points() else { return Update::default() };
        let outputs = points.map(|error| self.point(&error).0.inverse() * measured.reference_w.into_inner());
        let mean: Vector3<f64> = outputs.iter().enumerate().map(|(i, y)| y * weight(i)).sum();
        let mut innovation_covariance = Matrix3::identity() * measured.variance;
        let mut cross = SMatrix::<f64, 6, 3>::zeros();
        for (i, (error, output)) in points.iter().zip(&outputs).enumerate() {
            let deviation = output - mean;
            innovation_covariance += deviation * deviation.transpose() * weight(i);
            cross += error * deviation.transpose() * weight(i);
        }
        let Some(factor) = innovation_covariance.cholesky() else { return Update::default() };
        let innovation = measured.direction_b.into_inner() - mean;
        let gain = factor.solve(&cross.transpose()).transpose();
        let correction = gain * innovation;
        correct(&mut self.covariance, &gain, &cross, &innovation_covariance);
        let (q, bias) = self.point(&correction);
        (self.state.q_world_body, self.state.bias_rad_s) = (q, bias);
        self.state.q_world_body.renormalize_fast();
        Update { nis: innovation.dot(&factor.solve(&innovation)), dof: 2 }
    }

    fn solution(&self) -> Solution {
        self.state.solution(self.covariance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rodrigues_parameters_are_rotation_vectors_to_third_order() {
        for angle in [1e-3, 0.1, 1.0, 3.0] {
            let rotation = Vector3::new(0.6, 0.0, -0.8) * angle;
            let p = rodrigues(&quaternion_exp(&rotation));
            // f tan(angle / 4) with f = 4.
            assert!((p.norm() - 4.0 * (angle / 4.0).tan()).abs() < 1e-12);
            assert!(from_rodrigues(&p).angle_to(&quaternion_exp(&rotation)) < 1e-7);
        }
    }

    #[test]
    fn sigma_points_have_the_covariance() {
        let start = Solution {
            q_world_body: UnitQuaternion::identity(),
            omega_rad_s: Vector3::zeros(),
            gyro_bias_rad_s: Vector3::zeros(),
            covariance: Matrix6::from_fn(|i, j| if i == j { 1.0 + i as f64 } else { 0.3 }),
            wheel_momentum_b_n_m_s: Vector3::zeros(),
        };
        let filter = UnscentedFilter::new(&Parameters::motion_pak_ii(), &start);
        let points = filter.points().expect("definite");
        let covariance: Matrix6<f64> =
            points.iter().enumerate().map(|(i, e)| e * e.transpose() * weight(i)).sum();
        assert!((covariance - start.covariance).amax() < 1e-12);
        assert!(((0..POINTS).map(weight).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
