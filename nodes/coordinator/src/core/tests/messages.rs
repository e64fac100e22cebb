//! Messages that must not be used.

use super::*;
use proptest::prelude::*;

#[test]
fn late_old_future_and_broken_estimates_are_dropped_and_counted() {
    let mut lab = Laboratory::new(PAIR);
    let mut undisturbed = Laboratory::new(PAIR);
    lab.run(20.0);
    let mut good = lab.estimate(0);
    good.q_world_body = YawPitchRoll { yaw_rad: 2.0, ..YawPitchRoll::default() }.attitude().into();
    let now = lab.now;
    let stamped = |offset_ns: i64| {
        let mut message = good.clone();
        message.header.stamp = Timestamp(now.0 + offset_ns).into();
        message
    };
    let (mut broken, mut long, mut infinite) = (stamped(1), stamped(1), stamped(1));
    broken.q_world_body.x = f64::NAN;
    long.q_world_body.w = 2.0;
    infinite.omega_wb_b_rad_s.y = f64::INFINITY;
    let (late, old, future) = (stamped(-400_000_000), stamped(-5_000_000), stamped(500_000_000));
    for message in [broken, long, infinite, late, old, future] {
        lab.send(0, Topic::AttitudeEstimate, message);
    }
    let dropped = lab.core.links[0].dropped;
    assert_eq!((dropped.invalid, dropped.late, dropped.out_of_order, dropped.future), (3, 1, 1, 1));
    // None of them moved a reference: the run goes on as one that never saw them.
    undisturbed.run(25.0);
    lab.run(5.0);
    assert_eq!(lab.references, undisturbed.references);
}

#[test]
fn an_estimator_without_attitude_is_heard_whatever_its_numbers() {
    let mut lab = Laboratory::new(PAIR);
    lab.platforms[1].health = AttitudeEstimate::HEALTH_INITIALISING;
    lab.run(3.0);
    assert_eq!(lab.core.phase(), FormationState::PHASE_WAITING);
    assert!(lab.log.iter().any(|l| l.contains("whorl_2: estimator is initialising")), "{:?}", lab.log);
    let mut nan = lab.estimate(1);
    nan.q_world_body.w = f64::NAN;
    nan.header.stamp = Timestamp(lab.now.0 + 1).into();
    lab.send(1, Topic::AttitudeEstimate, nan);
    assert_eq!(lab.core.links[1].dropped.invalid, 0);
}

#[test]
fn gaps_in_the_sequence_count_as_losses() {
    let mut lab = Laboratory::new(PAIR);
    lab.run(2.0);
    lab.platforms[0].sequence += 3;
    lab.run(1.0);
    assert_eq!(lab.core.links[0].lost_estimates, 3);
    // A restarted estimator counts from 0 again: no loss.
    lab.platforms[0].sequence = 0;
    lab.run(1.0);
    assert_eq!(lab.core.links[0].lost_estimates, 3);
}

#[test]
fn a_status_of_an_unknown_mode_is_dropped() {
    let mut lab = Laboratory::new(PAIR);
    lab.run(1.0);
    let mut status = lab.status(0, true);
    status.mode = 77;
    status.header.stamp = Timestamp(lab.now.0 + 1).into();
    lab.send(0, Topic::ControlStatus, status);
    assert_eq!(lab.core.links[0].dropped.invalid, 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Whatever attitudes, rates and stamps arrive, references stay finite and inside every limit.
    #[test]
    fn noise_on_the_wire_never_breaks_a_reference(
        storm in prop::collection::vec(
            (0..2_usize, prop::array::uniform4(-1.0..1.0_f64), prop::array::uniform3(-5.0..5.0_f64),
             -500_000_000..200_000_000_i64, 0..5_u8, 0..6_u8),
            150,
        ),
    ) {
        let mut lab = Laboratory::new(PAIR);
        lab.run(14.0);
        for (index, [x, y, z, w], omega, offset_ns, health, mode) in storm {
            lab.step();
            let norm = (x * x + y * y + z * z + w * w).sqrt();
            let mut message = lab.estimate(index);
            message.health = health;
            message.q_world_body = whorl_msgs::geometry_msgs::Quaternion {
                x: x / norm, y: y / norm, z: z / norm, w: w / norm,
            };
            message.omega_wb_b_rad_s = omega.into();
            message.header.stamp = Timestamp(lab.now.0 + offset_ns).into();
            lab.send(index, Topic::AttitudeEstimate, message);
            let mut status = lab.status(index, true);
            status.mode = mode;
            status.header.stamp = Timestamp(lab.now.0 + offset_ns).into();
            lab.send(index, Topic::ControlStatus, status);
        }
        for (index, references) in lab.references.iter().enumerate() {
            for message in references {
                let reference = reference_of(message);
                prop_assert!(reference.is_finite());
                let q = reference.q_world_reference;
                let (tilt, max_deg) = if index == 0 {
                    (whorl_math::tilt_rad(&q), 4.0)
                } else {
                    (whorl_math::elevation_x_rad(&q).abs(), 29.0)
                };
                prop_assert!(tilt.to_degrees() <= max_deg + 1e-6, "{tilt}");
                prop_assert!(reference.omega_wr_r_rad_s.norm().to_degrees() < 6.0);
            }
        }
    }
}
