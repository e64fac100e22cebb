//! Every gate refuses what it must, names it, counts it, and the estimate survives.

use crate::conformance::simulation::{IMU_PERIOD_NS, Motion, Simulation};
use crate::{
    AttitudeBiasEstimator, FilterEvent, Flags, Health, ImuSample, Parameters, Rejection, SampleOutcome,
};
use nalgebra::Vector3;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

type Spoil = fn(&mut ImuSample);

fn running() -> (AttitudeBiasEstimator, Simulation) {
    let parameters = Parameters::motion_pak_ii().with_vector(Vector3::x_axis());
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut simulation = Simulation::new(Motion::platform(&mut rng), &parameters, 1);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    for _ in 0..1000 {
        simulation.drive(&mut filter);
    }
    (filter, simulation)
}

/// Feeds one spoiled sample; returns what became of gyro and accelerometer.
fn spoil(
    filter: &mut AttitudeBiasEstimator,
    simulation: &mut Simulation,
    change: impl Fn(&mut ImuSample),
) -> (SampleOutcome, SampleOutcome) {
    let parameters = *filter.parameters();
    let mut sample = simulation.imu(&parameters);
    change(&mut sample);
    let outcome = filter.on_imu(&sample);
    (outcome.gyro, outcome.accelerometer)
}

fn assert_survives(filter: &mut AttitudeBiasEstimator, simulation: &mut Simulation) {
    for _ in 0..100 {
        simulation.drive(filter);
    }
    let estimate = filter.estimate(simulation.stamp_ns());
    let error = simulation.error(&estimate).fixed_rows::<3>(0).norm();
    assert!(error.to_degrees() < 0.2, "{} deg", error.to_degrees());
    assert_eq!(estimate.health, Health::Ok);
    assert_eq!(estimate.flags, Flags::default());
}

#[test]
fn bad_gyro_samples_are_refused_and_bridged() {
    let (mut filter, mut simulation) = running();
    let cases: [(Spoil, Rejection); 4] = [
        (|s| s.gyro_rad_s.y = f64::NAN, Rejection::NotFinite),
        (|s| s.gyro_rad_s.z = f64::NEG_INFINITY, Rejection::NotFinite),
        (|s| s.gyro_rad_s.x = 5.0, Rejection::OutOfRange),
        (|s| s.gyro_rad_s.x += 1.5, Rejection::Spike),
    ];
    for (change, expected) in cases {
        let (gyro, accelerometer) = spoil(&mut filter, &mut simulation, change);
        assert_eq!(gyro, SampleOutcome::Rejected(expected));
        assert_eq!(accelerometer, SampleOutcome::Rejected(Rejection::NotUsable));
        let flags = filter.estimate(simulation.stamp_ns()).flags;
        assert!(flags.contains(Flags::GYRO_REJECTED));
        simulation.drive(&mut filter);
    }
    assert_eq!(filter.rejections()[0].of(Rejection::NotFinite), 2);
    assert_eq!(filter.rejections()[0].total(), 4);
    assert_eq!(filter.estimate(0).rejected_samples, 4);
    assert_survives(&mut filter, &mut simulation);
}

#[test]
fn a_real_step_of_the_rate_is_accepted_at_its_second_sample() {
    let (mut filter, mut simulation) = running();
    let jump = |s: &mut ImuSample| s.gyro_rad_s.z += 1.5;
    assert_eq!(spoil(&mut filter, &mut simulation, jump).0, SampleOutcome::Rejected(Rejection::Spike));
    assert_eq!(spoil(&mut filter, &mut simulation, jump).0, SampleOutcome::Used);
}

#[test]
fn bad_specific_forces_are_refused_while_the_gyro_goes_on() {
    let (mut filter, mut simulation) = running();
    let cases: [(Spoil, Rejection); 3] = [
        (|s| s.specific_force_m_s2.y = f64::NAN, Rejection::NotFinite),
        (|s| s.specific_force_m_s2.x = 60.0, Rejection::OutOfRange),
        (|s| s.specific_force_m_s2.z = 14.0, Rejection::NotGravity),
    ];
    for (change, expected) in cases {
        let (gyro, accelerometer) = spoil(&mut filter, &mut simulation, change);
        assert_eq!((gyro, accelerometer), (SampleOutcome::Used, SampleOutcome::Rejected(expected)));
    }
    let (_, accelerometer) = spoil(&mut filter, &mut simulation, |s| s.specific_force_m_s2.x += 1.0);
    assert!(matches!(accelerometer, SampleOutcome::Rejected(Rejection::Outlier { nis }) if nis > 27.6));
    assert_eq!(filter.rejections()[1].of(Rejection::Outlier { nis: 0.0 }), 1);
    let flags = filter.estimate(simulation.stamp_ns()).flags;
    assert!(flags.contains(Flags::ACCELEROMETER_REJECTED) && !flags.contains(Flags::GYRO_REJECTED));
    assert_survives(&mut filter, &mut simulation);
}

#[test]
fn frozen_sensors_are_found() {
    let (mut filter, mut simulation) = running();
    let mut first_refusal = None;
    for step in 0..60 {
        let (gyro, _) =
            spoil(&mut filter, &mut simulation, |s| s.gyro_rad_s = Vector3::new(0.01, 0.02, 0.03));
        if gyro == SampleOutcome::Rejected(Rejection::Frozen) {
            first_refusal.get_or_insert(step);
        }
    }
    assert_eq!(first_refusal, Some(19));
    for _ in 0..60 {
        let sample = |s: &mut ImuSample| s.specific_force_m_s2 = Vector3::new(0.0, 0.0, 9.81);
        spoil(&mut filter, &mut simulation, sample);
    }
    assert_eq!(filter.rejections()[1].of(Rejection::Frozen), 41);
    // A gyro that stays frozen starves the filter, which says so.
    for _ in 0..100 {
        spoil(&mut filter, &mut simulation, |s| s.gyro_rad_s = Vector3::zeros());
    }
    let estimate = filter.estimate(simulation.stamp_ns());
    assert_eq!(estimate.health, Health::Unhealthy);
    assert!(estimate.flags.contains(Flags::IMU_STALE));
}

#[test]
fn stamps_must_advance_and_a_clock_set_back_is_followed() {
    let (mut filter, mut simulation) = running();
    let before = filter.clone();
    let newest = simulation.stamp_ns();
    let duplicate = spoil(&mut filter, &mut simulation, |s| s.stamp_ns = newest);
    assert_eq!(duplicate.0, SampleOutcome::Rejected(Rejection::DuplicateStamp));
    let earlier = spoil(&mut filter, &mut simulation, |s| s.stamp_ns = newest - 1);
    assert_eq!(earlier.0, SampleOutcome::Rejected(Rejection::OutOfOrder));
    assert_eq!(filter.estimate(newest).q_world_body, before.estimate(newest).q_world_body);

    let parameters = *filter.parameters();
    let mut events = Vec::new();
    for _ in 0..100 {
        let mut sample = simulation.imu(&parameters);
        sample.stamp_ns -= 5_000_000_000;
        events.extend(filter.on_imu(&sample).event);
    }
    assert_eq!(events, [FilterEvent::RestartedAfterClockStep], "started anew without the vector yet");
}

#[test]
fn bad_vector_samples_are_refused() {
    let (mut filter, mut simulation) = running();
    let parameters = *filter.parameters();
    while simulation.step % 10 != 5 {
        simulation.drive(&mut filter);
    }
    let (now, last) = (simulation.stamp_ns(), simulation.stamp_ns() - 5 * IMU_PERIOD_NS);
    let truth =
        |s: &Simulation, stamp_ns: i64| s.motion.attitude(stamp_ns as f64 * 1e-9).inverse() * Vector3::x();
    let good = truth(&simulation, now);
    let refused = |outcome: (SampleOutcome, Option<FilterEvent>)| outcome.0.rejection();
    assert_eq!(refused(filter.on_vector(now, &Vector3::zeros())), Some(Rejection::NotFinite));
    assert_eq!(refused(filter.on_vector(now, &(good * f64::NAN))), Some(Rejection::NotFinite));
    assert_eq!(refused(filter.on_vector(last, &good)), Some(Rejection::DuplicateStamp));
    assert_eq!(refused(filter.on_vector(last - 1, &good)), Some(Rejection::OutOfOrder));
    assert_eq!(refused(filter.on_vector(now + 300_000_000, &good)), Some(Rejection::TooEarly));
    let outlier = filter.on_vector(now - 20_000_000, &(good + Vector3::y() * 0.1));
    assert!(matches!(outlier.0, SampleOutcome::Rejected(Rejection::Outlier { .. })), "{outlier:?}");
    assert!(filter.estimate(now).flags.contains(Flags::VECTOR_REJECTED));
    assert_eq!(filter.on_vector(now, &(good * 7.0)).0, SampleOutcome::Used, "any length will do");

    // Silence, then a sample that is too old.
    for _ in 0..100 {
        let sample = simulation.imu(&parameters);
        filter.on_imu(&sample);
    }
    let estimate = filter.estimate(simulation.stamp_ns());
    assert!(estimate.flags.contains(Flags::VECTOR_STALE));
    assert_eq!(estimate.health, Health::Degraded);
    let late = simulation.stamp_ns() - 300_000_000;
    assert_eq!(refused(filter.on_vector(late, &truth(&simulation, late))), Some(Rejection::Late));
    assert_eq!(filter.rejections()[2].total(), 7);

    let none = Parameters::motion_pak_ii();
    let mut without = AttitudeBiasEstimator::new(none).expect("allowed");
    assert_eq!(refused(without.on_vector(0, &good)), Some(Rejection::NotUsable));
    let mut early = AttitudeBiasEstimator::new(parameters).expect("allowed");
    assert_eq!(refused(early.on_vector(0, &good)), Some(Rejection::TooEarly));
}

/// A late sample during a fast turn is compared with the attitude at its stamp; an early one waits.
#[test]
fn late_and_early_vector_samples_are_used_at_their_own_time() {
    let mut parameters = Parameters::motion_pak_ii().with_vector(Vector3::x_axis());
    let mut motion = Motion::still();
    motion.yaw_rate_rad_s = 1.0;
    for delay_steps in [0, 5, 15] {
        let mut simulation = Simulation::new(motion.clone(), &parameters, 4);
        simulation.vector_delay_steps = delay_steps;
        let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
        for _ in 0..3000 {
            simulation.drive(&mut filter);
        }
        // Uncompensated, 150 ms would be 8.6 deg.
        let error = simulation.error(&filter.estimate(simulation.stamp_ns())).fixed_rows::<3>(0).norm();
        assert!(error.to_degrees() < 0.2, "{delay_steps}: {}", error.to_degrees());
    }
    // Early: stamped 4 ms after the newest IMU sample.
    parameters.vector = parameters.vector.map(|v| crate::VectorParameters { noise_rad: 1e-5, ..v });
    let mut simulation = Simulation::new(motion, &parameters, 4);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    let mut deferred = 0;
    for step in 0..3000 {
        let sample = simulation.imu(&parameters);
        let outcome = filter.on_imu(&sample);
        deferred += i32::from(matches!(outcome.vector, Some(SampleOutcome::Used)));
        if step % 10 == 0 {
            let stamp_ns = simulation.stamp_ns() + 4_000_000;
            let truth = simulation.motion.attitude(stamp_ns as f64 * 1e-9).inverse() * Vector3::x();
            assert_eq!(filter.on_vector(stamp_ns, &truth).0, SampleOutcome::Deferred);
        }
    }
    assert!(deferred > 290, "{deferred}");
    let error = simulation.error(&filter.estimate(simulation.stamp_ns()));
    assert!(error[2].abs().to_degrees() < 0.05, "{}", error[2].to_degrees());
}

/// Any input gives finite numbers and no panic.
#[test]
fn survives_random_garbage() {
    let (mut filter, mut simulation) = running();
    let mut rng = Pcg64Mcg::seed_from_u64(99);
    let parameters = *filter.parameters();
    let mut garbage = || f64::from_bits(rng.next_u64());
    for step in 0..20_000 {
        let mut sample = simulation.imu(&parameters);
        match step % 7 {
            0 => sample.gyro_rad_s = Vector3::new(garbage(), garbage(), garbage()),
            1 => sample.specific_force_m_s2 = Vector3::new(garbage(), garbage(), garbage()),
            2 => sample.stamp_ns = garbage().to_bits() as i64,
            3 => sample.gyro_rad_s.x = garbage() % 2.0,
            _ => {}
        }
        filter.on_imu(&sample);
        let direction = Vector3::new(garbage(), garbage(), garbage());
        filter.on_vector(garbage().to_bits() as i64 / 3, &direction);
        filter.on_vector(simulation.stamp_ns(), &direction);
        let estimate = filter.estimate(simulation.stamp_ns());
        assert!(estimate.covariance.iter().all(|v| v.is_finite()), "{step}");
        assert!((estimate.q_world_body.norm() - 1.0).abs() < 1e-9, "{step}");
        assert!(estimate.gyro_bias_b_rad_s.norm().is_finite(), "{step}");
    }
}
