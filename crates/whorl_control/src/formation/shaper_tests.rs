//! Tests of the shaper: limits at every step, consistency, convergence, no lag.

use super::*;
use crate::reference::{Reference, TiltEnvelope};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use whorl_dynamics::platform::TiltLimit;
use whorl_math::{attitude_error, quaternion_exp};

pub(super) const DT_S: f64 = 0.02;

pub(super) fn tabletop() -> ReferenceLimits {
    ReferenceLimits {
        envelope: TiltEnvelope::new(TiltLimit::Cone { max_rad: 0.0873 }, 0.01).unwrap(),
        rate_max_rad_s: 0.06,
        acceleration_max_rad_s2: 0.02,
    }
}

pub(super) fn dumbbell() -> ReferenceLimits {
    ReferenceLimits {
        envelope: TiltEnvelope::new(TiltLimit::Pitch { max_rad: 0.52 }, 0.03).unwrap(),
        ..tabletop()
    }
}

fn angles(yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> UnitQuaternion<f64> {
    YawPitchRoll { yaw_rad, pitch_rad, roll_rad }.attitude()
}

/// Asserts every promise of the shaper between two successive steps.
fn check_step(limits: &ReferenceLimits, before: &ReferenceShaper, after: &ReferenceShaper) {
    let (from, to) = (before.motion(), after.motion());
    assert!(to.rates_rad_s.norm() <= limits.rate_max_rad_s + 1e-12, "rate {}", to.rates_rad_s.norm());
    let acceleration = (to.rates_rad_s - from.rates_rad_s) / DT_S;
    assert!(acceleration.norm() <= limits.acceleration_max_rad_s2 + 1e-9, "{}", acceleration.norm());
    let tilt = limits.envelope.angle_rad(&to.angles.attitude());
    assert!(tilt <= limits.envelope.max_rad() + 1e-9, "tilt {tilt}");
    // The reference published a step ago, extrapolated, equals the current one.
    let carried = before.reference().extrapolated(DT_S);
    let now = after.reference();
    assert!(attitude_error(&carried.q_world_reference, &now.q_world_reference).norm() < 2e-7);
    assert!((carried.omega_wr_r_rad_s - now.omega_wr_r_rad_s).norm() < 5e-5);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn no_demand_whatever_breaks_a_limit(
        cone in any::<bool>(),
        demands in prop::collection::vec(
            (prop::array::uniform3(-3.5..3.5_f64), prop::array::uniform3(-0.3..0.3_f64), 1..150_u32, 0..8_u8),
            1..25,
        ),
    ) {
        let limits = if cone { tabletop() } else { dumbbell() };
        let mut shaper = ReferenceShaper::new(limits, 2.0, &UnitQuaternion::identity()).unwrap();
        for (attitude, motion, steps, kind) in demands {
            let mut asked = Reference {
                q_world_reference: quaternion_exp(&(Vector3::from(attitude) * if kind < 4 { 0.05 } else { 1.0 })),
                omega_wr_r_rad_s: Vector3::from(motion),
                omega_dot_wr_r_rad_s2: Vector3::from(motion) * -0.5,
            };
            for _ in 0..steps {
                asked = asked.extrapolated(DT_S);
                let demand = if kind == 0 { MotionDemand::Hold } else { MotionDemand::Follow(asked) };
                shaper.plan(&demand, DT_S);
                let before = shaper.clone();
                shaper.advance(DT_S);
                check_step(&limits, &before, &shaper);
            }
        }
    }

    #[test]
    fn any_allowed_attitude_is_reached_without_overshoot_in_yaw(
        yaw in -3.1..3.1_f64, pitch in -0.05..0.05_f64, roll in -0.05..0.05_f64,
    ) {
        let mut shaper = ReferenceShaper::new(tabletop(), 2.0, &angles(0.2, 0.02, -0.03)).unwrap();
        let goal = angles(yaw, pitch, roll);
        let mut furthest = 0.0_f64;
        let distance = whorl_math::wrap_angle_rad(yaw - 0.2);
        for _ in 0..5000 {
            let shaped = shaper.plan(&MotionDemand::Follow(Reference::at_rest(goal)), DT_S);
            prop_assert!(!shaped.clipped);
            shaper.advance(DT_S);
            furthest = furthest.max((shaper.motion().angles.yaw_rad - 0.2) * distance.signum());
        }
        prop_assert!(attitude_error(&goal, &shaper.reference().q_world_reference).norm() < 1e-8);
        prop_assert!(furthest < distance.abs() + 1e-4, "{furthest} {distance}");
    }
}

#[test]
fn a_long_slew_takes_the_time_of_the_trapezoid() {
    let limits = tabletop();
    let mut shaper = ReferenceShaper::new(limits, 2.0, &UnitQuaternion::identity()).unwrap();
    let goal = angles(1.0, 0.0, 0.0);
    let mut steps = 0;
    while attitude_error(&goal, &shaper.reference().q_world_reference).norm() > 1e-3 {
        shaper.plan(&MotionDemand::Follow(Reference::at_rest(goal)), DT_S);
        shaper.advance(DT_S);
        steps += 1;
        assert!(steps < 2000);
    }
    // 1/0.06 + (0.06/0.02)/2 + (0.06/0.014)/2 = 20.3 s to the goal, and the exponential end.
    let took_s = f64::from(steps) * DT_S;
    assert!((20.3..24.0).contains(&took_s), "{took_s}");
}

#[test]
fn a_demand_that_moves_within_the_limits_is_followed_without_lag() {
    let mut shaper = ReferenceShaper::new(dumbbell(), 1.0, &UnitQuaternion::identity()).unwrap();
    let motion = |t: f64| {
        let (a, w) = (Vector3::new(0.3, 0.1, -0.2), 0.1);
        YawPitchRollMotion {
            angles: YawPitchRoll::from_vector(a * (w * t).sin()),
            rates_rad_s: a * (w * (w * t).cos()),
            accelerations_rad_s2: a * (-w * w * (w * t).sin()),
        }
    };
    let mut worst = 0.0_f64;
    for k in 0..6000 {
        let t = f64::from(k) * DT_S;
        let demand = motion(t).reference();
        if t > 30.0 {
            let now = shaper.reference().q_world_reference;
            worst = worst.max(attitude_error(&demand.q_world_reference, &now).norm());
        }
        shaper.plan(&MotionDemand::Follow(demand), DT_S);
        shaper.advance(DT_S);
    }
    // Acceleration is held over a step, half a step late: w^3 A dt / 2 against the bandwidth squared.
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn the_step_response_is_the_critically_damped_one() {
    let mut shaper = ReferenceShaper::new(tabletop(), 2.0, &UnitQuaternion::identity()).unwrap();
    let size = 1e-3; // unsaturated
    let goal = Reference::at_rest(angles(size, 0.0, 0.0));
    for k in 0..300 {
        let t = f64::from(k) * DT_S;
        let expected = size * (1.0 - (1.0 + 2.0 * t) * (-2.0 * t).exp());
        assert!((shaper.motion().angles.yaw_rad - expected).abs() < 0.02 * size, "{t}");
        shaper.plan(&MotionDemand::Follow(goal), DT_S);
        shaper.advance(DT_S);
    }
}

#[test]
fn the_tilt_limit_is_reached_when_more_is_asked() {
    for limits in [tabletop(), dumbbell()] {
        let mut shaper = ReferenceShaper::new(limits, 2.0, &UnitQuaternion::identity()).unwrap();
        let goal = Reference::at_rest(angles(0.4, 1.0, 0.0));
        for _ in 0..3000 {
            assert!(shaper.plan(&MotionDemand::Follow(goal), DT_S).clipped);
            shaper.advance(DT_S);
        }
        let tilt = limits.envelope.angle_rad(&shaper.reference().q_world_reference);
        assert!((tilt - limits.envelope.max_rad()).abs() < 1e-6, "{tilt}");
        assert!((shaper.motion().angles.yaw_rad - 0.4).abs() < 0.02);
    }
}

#[test]
fn hold_and_nonsense_come_to_rest_at_the_limit_of_deceleration() {
    for demand in
        [
            MotionDemand::Hold,
            MotionDemand::Follow(Reference::at_rest(UnitQuaternion::new_unchecked(
                nalgebra::Quaternion::new(f64::NAN, 0.0, 0.0, 0.0),
            ))),
        ]
    {
        let mut shaper = ReferenceShaper::new(tabletop(), 2.0, &UnitQuaternion::identity()).unwrap();
        for _ in 0..500 {
            shaper.plan(&MotionDemand::Follow(Reference::at_rest(angles(2.0, 0.0, 0.0))), DT_S);
            shaper.advance(DT_S);
        }
        let rate = shaper.motion().rates_rad_s.norm();
        assert!((rate - 0.06).abs() < 1e-9);
        let mut steps = 0;
        while !shaper.at_rest() {
            shaper.plan(&demand, DT_S);
            shaper.advance(DT_S);
            steps += 1;
            assert!(steps <= 151, "0.06 / 0.02 = 3 s");
        }
        assert!(steps >= 150);
        let stood = shaper.plan(&demand, DT_S).reference;
        for _ in 0..10 {
            shaper.plan(&demand, DT_S);
            shaper.advance(DT_S);
        }
        assert_eq!(shaper.reference(), stood);
    }
}

#[test]
fn limits_lowered_while_moving_are_approached_smoothly() {
    let mut shaper = ReferenceShaper::new(dumbbell(), 2.0, &UnitQuaternion::identity()).unwrap();
    let goal = MotionDemand::Follow(Reference::at_rest(angles(2.0, 0.4, 0.3)));
    for _ in 0..1000 {
        shaper.plan(&goal, DT_S);
        shaper.advance(DT_S);
    }
    let lower = ReferenceLimits {
        envelope: TiltEnvelope::new(TiltLimit::Pitch { max_rad: 0.1 }, 0.0).unwrap(),
        rate_max_rad_s: 0.02,
        acceleration_max_rad_s2: 0.02,
    };
    shaper.set_limits(lower, 2.0).unwrap();
    for _ in 0..6000 {
        shaper.plan(&goal, DT_S);
        let before = shaper.motion();
        shaper.advance(DT_S);
        let change = (shaper.motion().rates_rad_s - before.rates_rad_s).norm() / DT_S;
        assert!(change <= 0.02 + 1e-9, "{change}");
    }
    assert!(shaper.motion().angles.pitch_rad <= 0.1 + 1e-6);
    assert!(shaper.set_limits(ReferenceLimits { rate_max_rad_s: -1.0, ..lower }, 2.0).is_err());
}

#[test]
fn a_restart_takes_over_the_motion_that_the_limits_allow() {
    let limits = tabletop();
    let mut shaper = ReferenceShaper::new(limits, 2.0, &UnitQuaternion::identity()).unwrap();
    let q = angles(1.0, 0.02, 0.0);
    shaper.restart_moving(&q, &Vector3::new(0.0, 0.0, 0.03), DT_S);
    assert!((shaper.reference().omega_wr_r_rad_s - Vector3::new(0.0, 0.0, 0.03)).norm() < 1e-12);
    shaper.restart_moving(&q, &Vector3::new(0.0, 0.0, 3.0), DT_S);
    assert!((shaper.motion().rates_rad_s.norm() - 0.06).abs() < 1e-12);
    // 0.06 rad/s takes 0.09 rad to stop, more than the tilt limit leaves.
    shaper.restart_moving(&q, &Vector3::new(0.0, 0.06, 0.0), DT_S);
    assert!(shaper.at_rest());
    shaper.restart_moving(&q, &Vector3::new(f64::NAN, 0.0, 0.0), DT_S);
    assert!(shaper.at_rest());
}
