//! Wrong starts, disturbances and interruptions.

use crate::conformance::simulation::{IMU_PERIOD_NS, Motion, Simulation};
use crate::{AttitudeBiasEstimator, Estimate, FilterEvent, Health, Parameters, VectorUse};
use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use whorl_math::unit;

const START_NS: i64 = IMU_PERIOD_NS;

fn parameters() -> Parameters {
    Parameters::motion_pak_ii().with_vector(Vector3::x_axis())
}

fn simulation(parameters: &Parameters, seed: u64) -> Simulation {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    Simulation::new(Motion::platform(&mut rng), parameters, seed)
}

fn error_deg(simulation: &Simulation, filter: &AttitudeBiasEstimator) -> f64 {
    let estimate = filter.estimate(simulation.stamp_ns());
    simulation.error(&estimate).fixed_rows::<3>(0).norm().to_degrees()
}

/// A filter started with an attitude that is wrong by `angle` about `axis` (world), with that uncertainty.
fn misled(simulation: &mut Simulation, axis: Vector3<f64>, angle: f64, sigma: f64) -> AttitudeBiasEstimator {
    let parameters = parameters();
    simulation.imu(&parameters);
    let wrong = UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(axis), angle);
    let bias = parameters.initial_bias_sigma_rad_s.powi(2);
    let variance = Vector6::new(sigma * sigma, sigma * sigma, sigma * sigma, bias, bias, bias);
    let q = wrong * simulation.motion.attitude(0.01);
    let covariance = Matrix6::from_diagonal(&variance);
    AttitudeBiasEstimator::with_attitude(parameters, START_NS, q, Vector3::zeros(), &covariance)
        .expect("allowed")
}

/// Every axis, every angle up to exactly half a turn, whether the filter knows of its uncertainty
/// or is sure of its wrong attitude.
#[test]
fn converges_from_any_wrong_attitude() {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(1.0, -1.0, 0.5)];
    for (index, axis) in axes.iter().enumerate() {
        for angle_deg in [90.0_f64, 120.0, 150.0, 179.0, 180.0] {
            for sigma in [3.0, 0.01] {
                let mut simulation = simulation(&parameters(), index as u64 + 10);
                let mut filter = misled(&mut simulation, *axis, angle_deg.to_radians(), sigma);
                for _ in 0..600 {
                    simulation.drive(&mut filter);
                }
                let error = error_deg(&simulation, &filter);
                assert!(error < 0.5, "{axis} {angle_deg} {sigma}: {error} deg after 6 s");
                for _ in 0..3000 {
                    simulation.drive(&mut filter);
                }
                let estimate = filter.estimate(simulation.stamp_ns());
                assert_eq!(estimate.health, Health::Ok, "{axis} {angle_deg} {sigma}");
                assert!(error_deg(&simulation, &filter) < 0.2);
            }
        }
    }
}

#[test]
fn first_attitude_is_right_upside_down_and_in_a_fast_spin() {
    for (roll, rate) in [(std::f64::consts::PI, 0.0), (1.5, 0.3), (0.0, 2.0)] {
        let mut parameters = parameters();
        parameters.gyro_range_rad_s = 10.0;
        let mut simulation = simulation(&parameters, 3);
        simulation.motion = Motion::still();
        simulation.motion.yaw_rate_rad_s = rate;
        simulation.motion.roll_offset_rad = roll;
        let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
        let mut started = None;
        for _ in 0..60 {
            let sample = simulation.imu(&parameters);
            started = started.or(filter.on_imu(&sample).event);
            if let Some((stamp_ns, direction)) = simulation.vector(&parameters) {
                filter.on_vector(stamp_ns, &direction);
            }
        }
        assert_eq!(started, Some(FilterEvent::StartedWithVector));
        let error = error_deg(&simulation, &filter);
        assert!(error < 1.0, "{roll} {rate}: {error}");
    }
}

#[test]
fn vector_that_comes_after_the_start_sets_the_heading() {
    let parameters = parameters();
    let mut simulation = simulation(&parameters, 5);
    simulation.motion.yaw_start_rad = 3.0;
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    for _ in 0..300 {
        let sample = simulation.imu(&parameters);
        filter.on_imu(&sample);
    }
    let estimate = filter.estimate(simulation.stamp_ns());
    assert_eq!(estimate.health, Health::Degraded);
    for _ in 0..100 {
        simulation.drive(&mut filter);
    }
    assert!(error_deg(&simulation, &filter) < 0.5);
    assert_eq!(filter.estimate(simulation.stamp_ns()).health, Health::Ok);
}

/// The vector sensor's reference turns by 40 deg (the lamp was moved): refused, then trusted.
#[test]
fn a_moved_reference_is_refused_then_believed_and_reported() {
    let parameters = parameters();
    let mut simulation = simulation(&parameters, 6);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    for _ in 0..1000 {
        simulation.drive(&mut filter);
    }
    let turned = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.7);
    let mut believed_after = None;
    for step in 0..400 {
        let sample = simulation.imu(&parameters);
        filter.on_imu(&sample);
        if let Some((stamp_ns, direction)) = simulation.vector(&parameters) {
            let attitude = simulation.motion.attitude(simulation.time_s());
            let moved = attitude.inverse() * (turned * (attitude * direction));
            let (_, event) = filter.on_vector(stamp_ns, &moved);
            if event == Some(FilterEvent::HeadingForgotten) {
                believed_after.get_or_insert(step);
            }
        }
        if step == 80 {
            assert!(error_deg(&simulation, &filter) < 0.3, "the jump was refused");
        }
    }
    let step = believed_after.expect("believed");
    assert!((95..115).contains(&step), "after about recovery_s: {step}");
    assert!((error_deg(&simulation, &filter) - 0.7_f64.to_degrees()).abs() < 0.5);
}

/// A magnetometer-like sensor with a false dip must not tilt the estimate in heading use.
#[test]
fn heading_use_leaves_tilt_alone() {
    let mut parameters = parameters();
    let down = unit(Vector3::new(0.0, 1.0, -2.0)).expect("unit");
    parameters = parameters.with_vector(down);
    let vector = parameters.vector.as_mut().expect("set");
    (vector.usage, vector.noise_rad) = (VectorUse::Heading, 0.02);
    let mut simulation = simulation(&parameters, 8);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    let dip_error = UnitQuaternion::from_scaled_axis(Vector3::x() * 0.2);
    let mut worst_tilt: f64 = 0.0;
    let mut started = None;
    for step in 0..6000 {
        let sample = simulation.imu(&parameters);
        started = started.or(filter.on_imu(&sample).event);
        if let Some((stamp_ns, direction)) = simulation.vector(&parameters) {
            let attitude = simulation.motion.attitude(simulation.time_s());
            let moved = attitude.inverse() * (dip_error * (attitude * direction));
            filter.on_vector(stamp_ns, &moved);
        }
        let truth = simulation.motion.attitude(simulation.time_s());
        let estimate = filter.estimate(simulation.stamp_ns());
        if step > 1000 {
            let vertical = estimate.q_world_body.inverse() * Vector3::z();
            worst_tilt = worst_tilt.max(vertical.angle(&(truth.inverse() * Vector3::z())));
        }
    }
    assert_eq!(started, Some(FilterEvent::StartedWithVector));
    assert!(worst_tilt.to_degrees() < 0.1, "{}", worst_tilt.to_degrees());
    assert!(error_deg(&simulation, &filter) < 1.0);
}

/// A knock on the accelerometer, and a stretch of wrong specific force.
#[test]
fn wrong_gravity_is_refused_and_persistent_disagreement_restarts() {
    let parameters = parameters();
    let mut simulation = simulation(&parameters, 9);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    for _ in 0..1000 {
        simulation.drive(&mut filter);
    }
    let sideways = UnitQuaternion::from_scaled_axis(Vector3::x() * 0.3);
    let mut events = Vec::new();
    for step in 0..300 {
        let mut sample = simulation.imu(&parameters);
        sample.specific_force_m_s2 = sideways * sample.specific_force_m_s2;
        events.extend(filter.on_imu(&sample).event.map(|event| (step, event)));
        if step == 50 {
            assert!(error_deg(&simulation, &filter) < 0.3, "refused so far");
        }
    }
    assert!(matches!(events.first(), Some((95..=105, FilterEvent::RestartedAfterOutliers))), "{events:?}");
    assert!(error_deg(&simulation, &filter) > 10.0, "it was believed in the end");
}

#[test]
fn a_gap_restarts_and_a_short_one_does_not() {
    let parameters = parameters();
    for (lost_samples, expected) in [(30, None), (60, Some(FilterEvent::RestartedAfterGap))] {
        let mut simulation = simulation(&parameters, 11);
        let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
        for _ in 0..1000 {
            simulation.drive(&mut filter);
        }
        for _ in 0..lost_samples {
            simulation.imu(&parameters);
        }
        let health = filter.estimate(simulation.stamp_ns()).health;
        assert_eq!(health == Health::Unhealthy, expected.is_some(), "{lost_samples}");
        let sample = simulation.imu(&parameters);
        assert_eq!(filter.on_imu(&sample).event, expected);
        for _ in 0..200 {
            simulation.drive(&mut filter);
        }
        assert!(error_deg(&simulation, &filter) < 0.5, "{lost_samples}");
        assert_eq!(filter.estimate(simulation.stamp_ns()).health, Health::Ok);
    }
}

/// Still starts give the bias at once; a moving start does not mistake its rate for bias.
#[test]
fn still_start_finds_the_bias() {
    let mut parameters = parameters();
    parameters.still_rate_sigma_rad_s = Some(1e-4);
    parameters.start_window_s = 2.0;
    let mut simulation_still = Simulation::new(Motion::still(), &parameters, 12);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    for _ in 0..210 {
        simulation_still.drive(&mut filter);
    }
    let error = simulation_still.error(&filter.estimate(simulation_still.stamp_ns()));
    assert!(error.fixed_rows::<3>(3).norm() < 5e-4, "{error}");

    let mut moving = simulation(&parameters, 12);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    for _ in 0..210 {
        moving.drive(&mut filter);
    }
    let estimate = filter.estimate(moving.stamp_ns());
    let error = moving.error(&estimate);
    for axis in 3..6 {
        assert!(error[axis].abs() < 4.0 * estimate.covariance[(axis, axis)].sqrt(), "{error}");
    }
}

#[test]
fn restored_filter_continues_bit_for_bit() {
    let mut parameters = parameters();
    parameters.accelerometer_position_b_m = Vector3::new(0.1, 0.0, 0.2);
    let mut simulation = simulation(&parameters, 13);
    let mut filter = AttitudeBiasEstimator::new(parameters).expect("allowed");
    let mut saved = None;
    let mut inputs = Vec::new();
    for step in 0..2000 {
        let sample = simulation.imu(&parameters);
        let vector = simulation.vector(&parameters);
        // In the middle of an accelerometer window, and of the start for the second pass.
        if step == 1013 {
            saved = Some(filter.clone());
        }
        if saved.is_some() {
            inputs.push((sample, vector));
        }
        filter.on_imu(&sample);
        if let Some((stamp_ns, direction)) = vector {
            filter.on_vector(stamp_ns, &direction);
        }
    }
    let mut restored = saved.expect("saved");
    for (sample, vector) in &inputs {
        restored.on_imu(sample);
        if let Some((stamp_ns, direction)) = vector {
            restored.on_vector(*stamp_ns, direction);
        }
    }
    let bits = |estimate: Estimate| {
        let q = estimate.q_world_body;
        let attitude = q.coords.iter().chain(estimate.gyro_bias_b_rad_s.iter());
        attitude.chain(estimate.covariance.iter()).map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(bits(restored.estimate(0)), bits(filter.estimate(0)));
    assert_eq!(restored, filter);
}
