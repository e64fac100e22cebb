//! The free-motion filter behind the interface of the platforms' filters, for replayed recordings.

use super::bias_state::BiasState;
use super::kernel::{DirectionMeasurement, FilterStep, Kernel, Solution, Update};
use crate::parameters::Parameters;
use nalgebra::{Matrix6, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;
use whorl_free_motion::{FreeMotionEstimator, FreeMotionParameters};

/// [`FreeMotionEstimator`] with a vector sensor that gives directions without their length: the magnetometer of a
/// freely moving sensor. The heading is counted from the reference direction's azimuth.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeMotionKernel {
    estimator: FreeMotionEstimator,
    time_ns: i64,
    /// Until the estimator has its own first attitude.
    until_started: BiasState,
    start_covariance: Matrix6<f64>,
    /// Takes a world whose y axis is magnetic north into that of the reference direction.
    from_magnetic: UnitQuaternion<f64>,
}

impl FreeMotionKernel {
    /// A filter that finds its own attitude; until then it turns the one given. Of the parameters it takes gravity and
    /// the field's direction in the world.
    #[must_use]
    pub fn new(parameters: &Parameters, start: &Solution) -> Self {
        let reference_w = parameters.vector.map(|vector| vector.reference_w);
        let azimuth = reference_w.map_or(FRAC_PI_2, |r| r.y.atan2(r.x));
        Self {
            estimator: FreeMotionEstimator::new(FreeMotionParameters {
                gravity_m_s2: parameters.gravity_m_s2,
                ..FreeMotionParameters::default()
            }),
            time_ns: 0,
            until_started: BiasState::new(start),
            start_covariance: start.covariance,
            from_magnetic: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth - FRAC_PI_2),
        }
    }
}

impl Kernel for FreeMotionKernel {
    fn step(&mut self, step: &FilterStep) -> Update {
        self.until_started.advance(step);
        self.time_ns += (step.dt_s * 1e9).round() as i64;
        if let Some(force) = &step.force_b_m_s2 {
            self.estimator.on_imu(self.time_ns, &step.gyro_rad_s, force);
        }
        Update::default()
    }

    fn takes_raw_force(&self) -> bool {
        true
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        self.estimator.on_magnetometer(&measured.direction_b);
        Update::default()
    }

    fn take_raw_vector(&mut self, vector_b: &Vector3<f64>) {
        self.estimator.on_magnetometer(vector_b);
    }

    fn solution(&self) -> Solution {
        let Some(estimate) = self.estimator.estimate() else {
            return self.until_started.solution(self.start_covariance);
        };
        let state = BiasState {
            q_world_body: self.from_magnetic * estimate.q_world_body,
            bias_rad_s: estimate.gyro_bias_rad_s,
            gyro_rad_s: self.until_started.gyro_rad_s,
        };
        // Attitude and bias errors in body axes do not depend on where the world's axes point.
        state.solution(self.estimator.covariance())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Unit;

    #[test]
    fn heading_is_counted_from_the_reference() {
        let truth = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
        let reference = Unit::new_normalize(Vector3::new(0.3, 0.8, -1.5));
        let start = Solution {
            q_world_body: UnitQuaternion::identity(),
            omega_rad_s: Vector3::zeros(),
            gyro_bias_rad_s: Vector3::zeros(),
            covariance: Matrix6::identity(),
            wheel_momentum_b_n_m_s: Vector3::zeros(),
        };
        let parameters = Parameters::motion_pak_ii().with_vector(reference);
        let mut kernel = FreeMotionKernel::new(&parameters, &start);
        let step = FilterStep {
            dt_s: 0.01,
            gyro_rad_s: Vector3::zeros(),
            gyro_before_rad_s: Vector3::zeros(),
            force_b_m_s2: Some(truth.inverse() * Vector3::z() * 9.81),
            wheel_momentum_b_n_m_s: Vector3::zeros(),
            jet_impulse_b_n_m_s: Vector3::zeros(),
        };
        for _ in 0..300 {
            kernel.step(&step);
            kernel.correct_direction(&DirectionMeasurement {
                direction_b: truth.inverse() * reference,
                reference_w: reference,
                variance: 1e-4,
            });
        }
        let solution = kernel.solution();
        assert!(solution.q_world_body.angle_to(&truth) < 1e-6);
        assert!(solution.covariance.cholesky().is_some());
    }
}
