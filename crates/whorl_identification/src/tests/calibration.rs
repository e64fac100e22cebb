//! A sensor with known errors, laid on its six faces and turned between.

use nalgebra::{UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::SensorSuite;
use whorl_math::{GRAVITY_M_S2, vertical_b};
use whorl_recording::Recording;

use crate::calibration::{CalibrationSettings, calibrate_imu};

fn sensors() -> SensorSuite {
    let mut sensors = PlatformModel::whorl_1_reference().sensors;
    let gyro = &mut sensors.gyro.errors;
    gyro.bias = Vector3::new(0.010, -0.004, 0.006);
    gyro.scale = Vector3::new(0.02, -0.015, 0.01);
    gyro.misalignment_rad = Vector3::new(0.004, -0.006, 0.008);
    gyro.range = 10.0;
    let force = &mut sensors.accelerometer.errors;
    force.bias = Vector3::new(0.05, -0.08, 0.03);
    force.scale = Vector3::new(0.004, -0.006, 0.008);
    force.misalignment_rad = Vector3::new(0.003, 0.002, -0.004);
    force.range = 100.0;
    sensors
}

/// Rotates through `turns` (axis times angle), 4 s each, resting 20 s before each and after the last.
fn record(sensors: &SensorSuite, turns: &[Vector3<f64>], rest_s: f64, seed: u128) -> Recording {
    let mut rng = Pcg64::new(seed, 1);
    let mut noise = || {
        let mut draw = || StandardNormal.sample(&mut rng);
        Vector3::new(draw(), draw(), draw())
    };
    let mut run = Recording { name: "faces".into(), ..Recording::default() };
    let (mut q, dt) = (UnitQuaternion::<f64>::identity(), 0.01);
    let mut time_s = 0.0;
    let mut sample = |time_s: f64, q: &UnitQuaternion<f64>, omega: Vector3<f64>| {
        let (g, a) = (sensors.gyro.errors, sensors.accelerometer.errors);
        run.gyro_b_rad_s.time_s.push(time_s);
        run.gyro_b_rad_s.value.push(g.reading(&omega, &g.bias, &noise()));
        run.specific_force_b_m_s2.time_s.push(time_s);
        run.specific_force_b_m_s2.value.push(a.reading(&(GRAVITY_M_S2 * vertical_b(q)), &a.bias, &noise()));
    };
    let rest = (rest_s / dt) as usize;
    for turn in turns.iter().map(Some).chain([None]) {
        for _ in 0..rest {
            sample(time_s, &q, Vector3::zeros());
            time_s += dt;
        }
        let Some(turn) = turn else { break };
        let start = q;
        for k in 0..400 {
            let phase = f64::from(k) / 400.0;
            let omega = turn / 4.0 * (1.0 - (std::f64::consts::TAU * phase).cos());
            sample(time_s, &q, omega);
            time_s += dt;
            let next = (f64::from(k) + 1.0) / 400.0;
            let angle = next - (std::f64::consts::TAU * next).sin() / std::f64::consts::TAU;
            q = start * UnitQuaternion::from_scaled_axis(turn * angle);
        }
    }
    run
}

fn quarter(x: f64, y: f64, z: f64) -> Vector3<f64> {
    Vector3::new(x, y, z) * std::f64::consts::FRAC_PI_2
}

fn check(what: &str, found: &crate::calibration::PerAxis, truth: &Vector3<f64>) {
    for axis in 0..3 {
        let miss = (found.value[axis] - truth[axis]) / found.stddev[axis];
        println!("{what} {axis}: {} true {} +- {}", found.value[axis], truth[axis], found.stddev[axis]);
        assert!(miss.abs() < 4.0, "{what} {axis}");
    }
}

#[test]
fn six_positions_and_turns_give_every_error_within_its_uncertainty() {
    let truth = sensors();
    let turns = [
        quarter(1., 0., 0.),
        quarter(1., 0., 0.),
        quarter(1., 0., 0.),
        quarter(1., 0., 0.),
        quarter(0., 1., 0.),
        quarter(0., 1., 0.),
        quarter(0., 1., 0.),
        quarter(0., 1., 0.),
        quarter(1., 0., 0.),
        quarter(0., 0., 1.),
        quarter(0., 0., 1.),
        quarter(0., 0., 1.),
    ];
    let run = record(&truth, &turns, 20.0, 3);
    let before = PlatformModel::whorl_1_reference().sensors;
    let found = calibrate_imu(&[&run], &before, &CalibrationSettings::default());
    println!("{:?}", found.findings);
    assert_eq!(found.still.len(), 13);
    check("accelerometer bias", &found.accelerometer.bias, &truth.accelerometer.errors.bias);
    check("accelerometer scale", &found.accelerometer.scale, &truth.accelerometer.errors.scale);
    check(
        "accelerometer misalignment",
        &found.accelerometer.misalignment_rad,
        &truth.accelerometer.errors.misalignment_rad,
    );
    check("gyro bias", &found.gyro.bias, &truth.gyro.errors.bias);
    check("gyro scale", &found.gyro.scale, &truth.gyro.errors.scale);
    check("gyro misalignment", &found.gyro.misalignment_rad, &truth.gyro.errors.misalignment_rad);
    assert!(found.accelerometer.bias.stddev.amax() < 0.01 && found.gyro.scale.stddev.amax() < 0.002);
    assert!((found.gyro.noise_stddev / 1.7e-3).add_scalar(-1.0).amax() < 0.08, "{}", found.gyro.noise_stddev);
    assert!(found.gyro.gaussianity.iter().flatten().all(|g| g.passes()));
}

#[test]
fn what_was_not_done_is_said() {
    let truth = sensors();
    let run = record(&truth, &[], 30.0, 4);
    let found = calibrate_imu(&[&run], &truth, &CalibrationSettings::default());
    let text: String = found.findings.iter().map(|f| f.text.as_str()).collect();
    assert_eq!(found.gyro.scale.determined(), [false; 3]);
    assert!(!found.accelerometer.bias.determined()[2] && !found.accelerometer.scale.determined()[2]);
    for sentence in ["Gyro scale not determined about x, y, z", "z down", "no temperature"] {
        assert!(text.contains(sentence), "{sentence}: {text}");
    }
    // Turns about the vertical alone, of known angle, determine the z gyro.
    let run = record(&truth, &[quarter(0., 0., 4.), quarter(0., 0., -4.)], 10.0, 5);
    let settings = CalibrationSettings {
        known_turn_rad: Some(std::f64::consts::TAU),
        turn_stddev_rad: 0.005,
        ..CalibrationSettings::default()
    };
    let found = calibrate_imu(&[&run], &truth, &settings);
    assert_eq!(found.gyro.scale.determined(), [false, false, true], "{:?}", found.gyro.scale);
    assert!((found.gyro.scale.value.z - truth.gyro.errors.scale.z).abs() < 4.0 * found.gyro.scale.stddev.z);
}
