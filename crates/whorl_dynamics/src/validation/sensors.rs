//! Statistics of the simulated sensors.

use nalgebra::{UnitQuaternion, Vector3};

use super::{free_platform, ns, plant};
use crate::platform::TriaxialErrors;
use crate::{InitialState, Plant, PlatformModel};

/// Mean and standard deviation per axis.
fn statistics(samples: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<Vector3<f64>>() / n;
    let squares: Vector3<f64> = samples.iter().map(|s| (s - mean).component_mul(&(s - mean))).sum();
    (mean, (squares / (n - 1.0)).map(f64::sqrt))
}

/// 100 Hz gyro samples of a body at rest.
fn still_gyro(model: &PlatformModel, count: i64, seed: u64) -> Vec<Vector3<f64>> {
    let mut p = Plant::new(model, &InitialState::default(), seed).unwrap();
    // Nothing moves: long steps are exact.
    p = p.with_step_ns(10_000_000);
    (1..=count)
        .map(|k| {
            p.advance_to(k * 10_000_000).unwrap();
            p.sample_imu().angular_velocity_rad_s
        })
        .collect()
}

fn errors_of(model: &mut PlatformModel) -> &mut TriaxialErrors {
    let errors = &mut model.sensors.gyro.errors;
    errors.bias_turn_on_stddev = Vector3::zeros();
    errors.bias_walk = Vector3::zeros();
    errors
}

#[test]
fn bias_and_noise_reach_the_measurement() {
    let mut model = free_platform();
    let (bias, sigma) = (Vector3::new(0.01, -0.02, 0.03), Vector3::new(1e-3, 2e-3, 3e-3));
    let errors = errors_of(&mut model);
    (errors.bias, errors.noise_stddev) = (bias, sigma);
    let samples = still_gyro(&model, 20_000, 5);
    let (mean, stddev) = statistics(&samples);
    // Four standard errors: 1/sqrt(20000) of sigma for the mean, 1/sqrt(40000) for sigma itself.
    assert!((mean - bias).component_div(&sigma).amax() < 4.0 / 141.0, "{mean}");
    assert!((stddev.component_div(&sigma) - Vector3::repeat(1.0)).amax() < 4.0 / 200.0, "{stddev}");
    // White: neighbouring samples are uncorrelated.
    let lag_one: Vector3<f64> = samples.windows(2).map(|w| (w[0] - mean).component_mul(&(w[1] - mean))).sum();
    let correlation = (lag_one / 20_000.0).component_div(&sigma.component_mul(&sigma));
    assert!(correlation.amax() < 4.0 / 141.0, "{correlation}");
}

#[test]
fn turn_on_bias_differs_between_runs_by_its_stddev() {
    let mut model = free_platform();
    let errors = errors_of(&mut model);
    errors.noise_stddev = Vector3::zeros();
    errors.bias_turn_on_stddev = Vector3::new(1e-3, 5e-3, 0.0);
    let runs: Vec<Vector3<f64>> = (0..2000).map(|seed| still_gyro(&model, 1, seed)[0]).collect();
    let (mean, stddev) = statistics(&runs);
    assert!(mean.x.abs() < 4.0 * 1e-3 / 44.7 && mean.y.abs() < 4.0 * 5e-3 / 44.7, "{mean}");
    assert!((stddev.x / 1e-3 - 1.0).abs() < 4.0 / 63.2 && (stddev.y / 5e-3 - 1.0).abs() < 4.0 / 63.2);
    assert_eq!(stddev.z, 0.0);
}

/// The variance of a bias walk grows as intensity^2 t, whatever the sample rate.
#[test]
fn bias_walk_grows_with_the_root_of_time() {
    let mut model = free_platform();
    let errors = errors_of(&mut model);
    errors.noise_stddev = Vector3::zeros();
    errors.bias_walk = Vector3::repeat(1e-3);
    for (count, period_ns) in [(100, 10_000_000), (10, 100_000_000), (400, 10_000_000)] {
        let ends: Vec<Vector3<f64>> = (0..700)
            .map(|seed| {
                let mut p = Plant::new(&model, &InitialState::default(), seed).unwrap();
                p = p.with_step_ns(period_ns);
                let mut last = Vector3::zeros();
                for k in 1..=count {
                    p.advance_to(k * period_ns).unwrap();
                    last = p.sample_imu().angular_velocity_rad_s;
                }
                assert!((p.truth().gyro_bias_rad_s - last).norm() < 1e-15, "the truth knows the bias");
                last
            })
            .collect();
        let elapsed_s = (count * period_ns) as f64 * 1e-9;
        let (_, stddev) = statistics(&ends);
        let ratio = stddev / (1e-3 * elapsed_s.sqrt());
        // 700 runs: sigma is known to 1/sqrt(1400) = 2.7 %.
        assert!((ratio - Vector3::repeat(1.0)).amax() < 4.0 * 0.027, "{elapsed_s} s: {ratio}");
    }
}

/// White noise falls as 1/sqrt(T) in the Allan deviation, a walk rises as sqrt(T/3) (IEEE Std 952).
#[test]
fn allan_deviation_shows_noise_and_walk() {
    let mut model = free_platform();
    let errors = errors_of(&mut model);
    errors.noise_stddev = Vector3::new(1e-2, 0.0, 0.0);
    errors.bias_walk = Vector3::new(0.0, 1e-3, 0.0);
    let samples = still_gyro(&model, 60_000, 11);
    let allan = |axis: usize, length: usize| {
        let means: Vec<f64> = samples
            .chunks_exact(length)
            .map(|c| c.iter().map(|s| s[axis]).sum::<f64>() / length as f64)
            .collect();
        let squares: f64 = means.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum();
        (0.5 * squares / (means.len() - 1) as f64).sqrt()
    };
    for length in [10_usize, 100, 300] {
        let expected = 1e-2 / (length as f64).sqrt();
        assert!((allan(0, length) / expected - 1.0).abs() < 0.2, "white, {length}");
        let cluster_s = length as f64 * 0.01;
        let expected = 1e-3 * (cluster_s / 3.0).sqrt();
        assert!((allan(1, length) / expected - 1.0).abs() < 0.2, "walk, {length}: {}", allan(1, length));
    }
}

#[test]
fn accelerometer_feels_gravity_spin_and_angular_acceleration() {
    let mut model = free_platform();
    let errors = &mut model.sensors.accelerometer.errors;
    errors.noise_stddev = Vector3::zeros();
    errors.bias_turn_on_stddev = Vector3::zeros();
    errors.bias_walk = Vector3::zeros();
    errors.range = 1e3;
    model.sensors.accelerometer.lever_arm_b_m = Vector3::new(0.3, 0.0, 0.0);
    // At rest, rolled to the left side down by 30 degrees about x: gravity from REP-145.
    let rolled = InitialState {
        q_world_body: UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 30.0_f64.to_radians()),
        ..InitialState::default()
    };
    let at_rest = plant(&model, &rolled).sample_imu().specific_force_m_s2;
    assert!((at_rest - Vector3::new(0.0, 9.81 * 0.5, 9.81 * 0.75_f64.sqrt())).norm() < 1e-12, "{at_rest}");
    // Level, wheel z torque 0.3 N m: dwz/dt = -0.3/(Izz - J) about, and wz = 2 rad/s: centripetal -w^2 r.
    let inertia = nalgebra::Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    super::set_mass(&mut model, Some(inertia), Vector3::zeros());
    let spinning = InitialState { omega_wb_b_rad_s: Vector3::z() * 2.0, ..InitialState::default() };
    let mut p = plant(&model, &spinning);
    p.command_wheels(&[0.0, 0.0, 0.3]).unwrap();
    let y = p.sample_imu().specific_force_m_s2;
    let expected = Vector3::new(-4.0 * 0.3, -0.3 / (12.0 - 0.08) * 0.3, 9.81);
    assert!((y - expected).norm() < 1e-12, "{y}");
}

#[test]
fn late_data_are_the_truth_of_then() {
    let mut model = free_platform();
    let inertia = nalgebra::Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0));
    super::set_mass(&mut model, Some(inertia), Vector3::zeros());
    let errors = errors_of(&mut model);
    errors.noise_stddev = Vector3::zeros();
    errors.latency_s = 0.0123;
    if let Some(sensor) = &mut model.sensors.vector {
        (sensor.latency_s, sensor.noise_stddev_rad) = (0.0377, 0.0);
    }
    let mut p = plant(&model, &InitialState::default());
    p.command_wheels(&[0.0, 0.0, -0.3]).unwrap();
    let acceleration = 0.3 / (12.0 - 0.08);
    p.advance_to(ns(1.0)).unwrap();
    let z = p.sample_imu().angular_velocity_rad_s.z;
    assert!((z - acceleration * (1.0 - 0.0123)).abs() < 1e-9, "{z}");
    let direction = p.sample_vector().unwrap().direction;
    let yaw = 0.5 * acceleration * (1.0 - 0.0377_f64).powi(2);
    assert!((direction.into_inner() - Vector3::new(yaw.cos(), -yaw.sin(), 0.0)).norm() < 1e-7);
}

#[test]
fn vector_sensor_noise_has_its_stddev_across_the_direction() {
    let mut p = plant(&free_platform(), &InitialState::default());
    let sigma = p.gyrostat().model().sensors.vector.unwrap().noise_stddev_rad;
    let samples: Vec<Vector3<f64>> =
        (0..10_000).map(|_| p.sample_vector().unwrap().direction.into_inner()).collect();
    let (mean, stddev) = statistics(&samples);
    assert!((mean - Vector3::x()).norm() < 1e-4);
    assert!((stddev.y / sigma - 1.0).abs() < 0.03 && (stddev.z / sigma - 1.0).abs() < 0.03, "{stddev}");
}

#[test]
fn the_same_seed_gives_the_same_run_and_streams_are_independent() {
    let run = |model: &PlatformModel, seed: u64, also_others: bool| {
        let mut p = Plant::new(model, &InitialState::default(), seed).unwrap();
        let mut samples = Vec::new();
        for k in 1..=50 {
            p.advance_to(k * 10_000_000).unwrap();
            if also_others {
                let _ = (p.sample_vector(), p.sample_wheels(), p.sample_bus_voltage_v());
                let _ = (p.sample_tank_pressure_pa(), p.sample_temperature_k());
            }
            samples.push(p.sample_imu());
        }
        samples
    };
    let model = PlatformModel::whorl_1_reference();
    assert_eq!(run(&model, 3, false), run(&model, 3, true), "other sensors draw from other streams");
    assert_ne!(run(&model, 3, false), run(&model, 4, false));
}

#[test]
fn slow_channels_follow_their_laws() {
    let mut model = free_platform();
    model.sensors.bus_voltage.noise_stddev = 0.0;
    model.sensors.temperature.noise_stddev = 0.0;
    model.sensors.tank_pressure.noise_stddev = 0.0;
    let mut p = plant(&model, &InitialState::default());
    p.advance_to(ns(10.0)).unwrap();
    p.command_wheels(&[0.2, -0.1, 0.0]).unwrap();
    assert!((p.sample_bus_voltage_v() - (25.2 - 2e-3 - 0.5 * 0.3)).abs() < 1e-12);
    assert!((p.sample_temperature_k() - (293.15 + 0.02)).abs() < 1e-12);
    assert!((p.sample_tank_pressure_pa() / 2e7 - 1.0).abs() < 1e-12);
}
