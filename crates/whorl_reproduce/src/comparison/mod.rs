//! The dissertation's filters that its later ones supersede, to compare them (sections 4.5.2 and 4.5.3).
//!
//! They take the gyro's bias as known and have no state for an unmodelled torque: for operation there is
//! [`FilterKind::GYROSTAT`].

mod attitude_rate;
mod quaternion_rate;
mod rate_model;
mod rate_state;

pub use attitude_rate::AttitudeRateFilter;
pub use quaternion_rate::QuaternionRateFilter;

use whorl_estimation::FilterKind;

/// Quaternion and rate (4.5.2).
pub const QUATERNION_RATE: FilterKind<QuaternionRateFilter> = FilterKind {
    name: "quaternion_rate",
    needs_body: true,
    own_gates: false,
    start: Some(QuaternionRateFilter::new),
};

/// Attitude error and rate (4.5.3).
pub const ATTITUDE_RATE: FilterKind<AttitudeRateFilter> = FilterKind {
    name: "attitude_rate",
    needs_body: true,
    own_gates: false,
    start: Some(AttitudeRateFilter::new),
};

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use whorl_estimation::conformance;
    use whorl_estimation::kernels::Kernel;
    use whorl_estimation::{BodyModel, Estimator};

    #[test]
    fn they_wait_for_wheels() {
        conformance::waits_for_wheels_only_if_needed(QUATERNION_RATE);
        conformance::waits_for_wheels_only_if_needed(ATTITUDE_RATE);
        assert!(Estimator::new(QUATERNION_RATE, conformance::parameters(), None).is_err());
    }

    #[test]
    fn they_converge_from_any_attitude() {
        conformance::converges_from_any_attitude(QUATERNION_RATE);
        conformance::converges_from_any_attitude(ATTITUDE_RATE);
    }

    #[test]
    fn they_follow_a_wheel() {
        conformance::follows_a_wheel(QUATERNION_RATE);
        conformance::follows_a_wheel(ATTITUDE_RATE);
    }

    #[test]
    #[ignore = "slow: NEES of the filters that are only compared"]
    fn they_are_consistent() {
        conformance::is_consistent_with_dynamics(QUATERNION_RATE);
        conformance::is_consistent_with_dynamics(ATTITUDE_RATE);
    }

    #[test]
    fn they_do_not_allocate() {
        assert_eq!(allocations(QUATERNION_RATE), 0);
        assert_eq!(allocations(ATTITUDE_RATE), 0);
    }

    fn allocations<K: Kernel>(kind: FilterKind<K>) -> u64 {
        let body = BodyModel::new(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0)), Vector3::zeros());
        let samples = conformance::samples(1000);
        let mut estimator = Estimator::new(kind, conformance::parameters(), Some(body)).expect("allowed");
        let counted = allocation_counter::measure(|| {
            for (imu, vector) in &samples {
                estimator.on_wheels(imu.stamp_ns, Vector3::zeros(), Vector3::zeros());
                estimator.on_imu(imu);
                if let Some((stamp_ns, direction)) = vector {
                    estimator.on_vector(*stamp_ns, direction);
                }
                std::hint::black_box(estimator.estimate(imu.stamp_ns));
            }
        });
        assert!(estimator.chosen_filter_runs());
        counted.count_total
    }
}
