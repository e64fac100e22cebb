//! All filters on the same runs.

use crate::conformance;
use crate::conformance::{parameters, samples};
use crate::{BodyModel, Estimator, FilterKind};
use nalgebra::{Matrix3, Vector3};

#[test]
fn names_are_found_again() {
    for kind in FilterKind::ALL {
        assert_eq!(FilterKind::find(kind.name), Some(kind));
        assert_eq!(Estimator::new(kind, parameters(), None).is_err(), kind.needs_body);
    }
}

#[test]
fn filters_that_need_no_wheels_do_not_wait_for_them() {
    FilterKind::ALL.into_iter().for_each(conformance::waits_for_wheels_only_if_needed);
}

#[test]
fn all_filters_converge_from_any_attitude() {
    // A filter with gates of its own finds its own first attitude.
    FilterKind::ALL
        .into_iter()
        .filter(|kind| !kind.own_gates)
        .for_each(conformance::converges_from_any_attitude);
}

/// What docs/estimation.md says of the filters by themselves, without the restart from two vectors.
#[test]
fn filters_by_themselves_converge_as_documented() {
    let slanted = nalgebra::Unit::new_normalize(Vector3::new(0.6, 0.5, 0.6));
    let axes =
        [("x", Vector3::x_axis()), ("y", Vector3::y_axis()), ("z", Vector3::z_axis()), ("slanted", slanted)];
    for kind in [FilterKind::ITERATED, FilterKind::UNSCENTED, FilterKind::INVARIANT] {
        for (name, axis) in axes {
            for angle_deg in [90.0, 150.0, 179.0, 180.0] {
                let within = conformance::own_convergence_s(kind, axis, angle_deg);
                let text = within.map_or("never".to_owned(), |s| format!("{s:.1} s"));
                println!("{:<12} {angle_deg:>5} deg about {name:<8} {text}", kind.name);
                let below = |limit: f64| within.is_some_and(|s| s < limit);
                let documented = match (kind.name, angle_deg, name) {
                    ("iterated", angle, _) if angle < 180.0 => below(1.0),
                    ("iterated" | "invariant", ..) => below(20.0),
                    (_, angle, "x" | "y") if angle > 170.0 => within.is_none(),
                    _ => below(60.0),
                };
                assert!(documented, "{} {name} {angle_deg}: {text}", kind.name);
            }
        }
    }
}

#[test]
fn filters_with_dynamics_follow_a_wheel() {
    conformance::follows_a_wheel(FilterKind::GYROSTAT);
}

#[test]
#[ignore = "slow: NEES of every filter with a bias"]
fn bias_filters_are_consistent_at_each_instant() {
    super::optimum::BIAS_FILTERS.into_iter().for_each(conformance::is_consistent_with_a_bias);
}

/// Kernels that are told one number of noise for both axes of the vertical are told that of the worse.
#[test]
fn bias_filters_are_consistent_with_a_lever_arm() {
    super::optimum::BIAS_FILTERS.into_iter().for_each(conformance::is_consistent_with_a_lever_arm);
}

#[test]
#[ignore = "slow: NEES of the filters with dynamics"]
fn filters_with_dynamics_are_consistent() {
    conformance::is_consistent_with_dynamics(FilterKind::GYROSTAT);
}

/// Nothing is allocated by a filter, its start included.
#[test]
fn filters_do_not_allocate() {
    let inertia = Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    let samples = samples(1000);
    for kind in FilterKind::ALL {
        let body = BodyModel::new(inertia, Vector3::zeros());
        let mut estimator = Estimator::new(kind, parameters(), Some(body)).expect("allowed");
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
        assert_eq!(counted.count_total, 0, "{}", kind.name);
    }
}
