//! A sensor with known errors, laid on its six faces and turned between.

use nalgebra::{UnitQuaternion, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::SensorSuite;
use whorl_math::{GRAVITY_M_S2, allan_deviation, noise_densities, vertical_b};
use whorl_recording::Recording;

use crate::{CalibrationSettings, calibrate_imu};

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

fn check(what: &str, found: &crate::PerAxis, truth: &Vector3<f64>) {
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
    assert_eq!(found.still_stretches, 13);
    // Without an axis nothing is calibrated, and the reason is said.
    let mut partial = run.clone();
    partial.no_force_axis = [false, true, false];
    partial.specific_force_b_m_s2.value.iter_mut().for_each(|force| force.y = 0.0);
    let refused = calibrate_imu(&[&partial], &before, &CalibrationSettings::default());
    assert!(refused.still_stretches == 0 && refused.findings[0].fatal, "{:?}", refused.findings);
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
    let noise = found.gyro.noise_stddev.value;
    assert!((noise / 1.7e-3).add_scalar(-1.0).amax() < 0.08, "{noise}");
}

/// Rests of 8 s in faces and oblique positions, turned from one to the next.
fn oblique() -> Vec<Vector3<f64>> {
    let degrees = |x: f64, y: f64, z: f64, angle: f64| {
        let axis = Vector3::new(x, y, z);
        axis * (angle.to_radians() / axis.norm())
    };
    [
        degrees(1., 0., 0., 90.),
        degrees(1., 0., 0., 90.),
        degrees(1., 0., 0., 90.),
        degrees(0., 1., 0., 90.),
        degrees(0., 0., 1., 90.),
        degrees(0., 1., 0., 90.),
        degrees(1., 1., 0., 90.),
        degrees(1., 0., 1., 70.),
        degrees(0., 1., 1., 110.),
        degrees(1., -1., 1., 90.),
        degrees(1., 0., 0., 135.),
        degrees(0., 1., 0., 55.),
        degrees(1., 2., 1., 100.),
        degrees(-1., 1., 2., 80.),
        degrees(2., 1., -1., 120.),
    ]
    .to_vec()
}

/// What the sensors read whose axes see `skew` of each other (y of x, z of x, z of y), where gravity is `gravity`.
fn skewed(run: &Recording, sensors: &SensorSuite, skew: [Vector3<f64>; 2], gravity: f64) -> Recording {
    let mut run = run.clone();
    let [of_gyro, of_force] = skew;
    let tangle = |values: &mut Vec<Vector3<f64>>,
                  errors: &whorl_dynamics::platform::TriaxialErrors,
                  skew: &Vector3<f64>,
                  by: f64| {
        for y in values {
            let scale = errors.scale.add_scalar(1.0);
            let x = (*y - errors.bias).component_div(&scale) * by;
            let tangled = Vector3::new(x.x, x.y + skew.x * x.x, x.z + skew.y * x.x + skew.z * x.y);
            *y = tangled.component_mul(&scale) + errors.bias;
        }
    };
    tangle(&mut run.gyro_b_rad_s.value, &sensors.gyro.errors, &of_gyro, 1.0);
    tangle(
        &mut run.specific_force_b_m_s2.value,
        &sensors.accelerometer.errors,
        &of_force,
        gravity / GRAVITY_M_S2,
    );
    run
}

#[test]
fn axes_that_are_not_at_right_angles_are_told_from_bias_and_scale() {
    let mut truth = sensors();
    truth.accelerometer.errors.misalignment_rad = Vector3::zeros();
    truth.gyro.errors.misalignment_rad = Vector3::zeros();
    let before = PlatformModel::whorl_1_reference().sensors;
    let straight = record(&truth, &oblique(), 8.0, 11);
    let skew = [Vector3::new(0.01, -0.008, 0.012), Vector3::new(-0.006, 0.01, 0.021)];
    for (skew, gravity, given) in [
        ([Vector3::zeros(); 2], GRAVITY_M_S2, None),
        (skew, GRAVITY_M_S2, None),
        (skew, 9.781, None),
        (skew, 9.832, Some(9.832)),
    ] {
        let run = skewed(&straight, &truth, skew, gravity);
        let settings = CalibrationSettings { gravity_m_s2: given, ..CalibrationSettings::default() };
        let found = calibrate_imu(&[&run], &before, &settings);
        println!("{skew:?} {gravity} {given:?}: {:?} {:?}", found.accelerometer.misfit, found.gyro.misfit);
        check("accelerometer bias", &found.accelerometer.bias, &truth.accelerometer.errors.bias);
        check("accelerometer scale", &found.accelerometer.scale, &truth.accelerometer.errors.scale);
        check("accelerometer skew", &found.accelerometer.skew_rad, &skew[1]);
        check("gyro scale", &found.gyro.scale, &truth.gyro.errors.scale);
        check("gyro skew", &found.gyro.skew_rad, &skew[0]);
        // A common scale is not told from gravity, unless that is given.
        let scale = found.accelerometer.scale.stddev.amax();
        assert!(if given.is_some() { scale < 4e-4 } else { (1e-3..3e-3).contains(&scale) }, "{scale}");
        assert!(found.accelerometer.skew_rad.stddev.amax() < 1e-3);
        assert_eq!(found.accelerometer.misfit.unwrap().fits(), Some(true));
    }
}

#[test]
fn a_sensor_that_does_not_fit_is_said_and_its_deviations_grow() {
    let truth = sensors();
    let before = PlatformModel::whorl_1_reference().sensors;
    let good = record(&truth, &oblique(), 8.0, 12);
    let mut bad = good.clone();
    // A quadratic error of the x axis: 0.02 m/s^2 at 1 g.
    for y in &mut bad.specific_force_b_m_s2.value {
        y.x += 2e-4 * y.x * y.x;
    }
    let [good, bad] = [good, bad].map(|run| calibrate_imu(&[&run], &before, &CalibrationSettings::default()));
    let says = |found: &crate::ImuCalibration| {
        found.findings.iter().any(|f| f.text.contains("do not fit the model of the accelerometer"))
    };
    assert!(!says(&good) && says(&bad), "{:?}", bad.findings);
    let ratio = bad.accelerometer.misfit.unwrap().ratio().unwrap();
    let grown = bad.accelerometer.bias.stddev.component_div(&good.accelerometer.bias.stddev);
    assert!(ratio > 2.0 && (grown / ratio).add_scalar(-1.0).amax() < 0.2, "{ratio} {grown}");
}

/// Two recordings of one sensor agree within three stated deviations, nearly always.
#[test]
fn two_recordings_of_one_sensor_agree_within_what_is_stated() {
    let truth = sensors();
    let before = PlatformModel::whorl_1_reference().sensors;
    let (mut beyond, mut all) = (0, 0);
    for pair in 0..3 {
        let one = |seed: u128| {
            let run = record(&truth, &oblique(), 8.0, seed);
            calibrate_imu(&[&run], &before, &CalibrationSettings::default())
        };
        let [a, b] = [one(100 + 2 * pair), one(101 + 2 * pair)];
        for (a, b) in [
            (a.accelerometer.bias, b.accelerometer.bias),
            (a.accelerometer.scale, b.accelerometer.scale),
            (a.accelerometer.skew_rad, b.accelerometer.skew_rad),
            (a.gyro.bias, b.gyro.bias),
            (a.gyro.scale, b.gyro.scale),
        ] {
            for axis in 0..3 {
                all += 1;
                let apart = (a.value[axis] - b.value[axis]).abs();
                beyond += usize::from(apart > 3.0 * a.stddev[axis].hypot(b.stddev[axis]));
            }
        }
    }
    assert!(beyond <= 1, "{beyond} of {all}");
}

#[test]
fn what_was_not_done_is_said() {
    let truth = sensors();
    let run = record(&truth, &[], 30.0, 4);
    let found = calibrate_imu(&[&run], &truth, &CalibrationSettings::default());
    let text: String = found.findings.iter().map(|f| f.text.as_str()).collect();
    assert_eq!(found.gyro.scale.determined(), [false; 3]);
    assert!(!found.accelerometer.bias.determined()[2] && !found.accelerometer.scale.determined()[2]);
    for sentence in ["Gyro scale not determined about x, y, z", "Accelerometer bias not determined about"] {
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

/// White noise and a walk of known size, many records: the stated deviations are those of the results, within a factor.
#[test]
fn stated_deviations_are_those_of_many_records() {
    let (dt, white, walk) = (0.05_f64, 0.001, 2e-4);
    let (mut squares, mut beyond, mut floors, count) = ([0.0; 2], 0, 0, 60);
    for seed in 0..count {
        let mut rng = Pcg64::new(seed, 3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut bias = 0.0;
        let samples: Vec<f64> = (0..14_000)
            .map(|_| {
                bias += walk * dt.sqrt() * normal();
                bias + white * normal()
            })
            .collect();
        let curve = allan_deviation(&samples, dt, 8);
        let (sample, sample_stddev) = (curve[0].deviation, curve[0].deviation * curve[0].relative_error);
        let found = noise_densities(&curve).unwrap();
        assert!((sample - white).abs() < 5.0 * sample_stddev + 0.01 * white, "{sample}");
        let off =
            [(found.white - white * dt.sqrt()) / found.white_stddev, (found.walk - walk) / found.walk_stddev];
        for (sum, off) in squares.iter_mut().zip(off) {
            *sum += off * off / f64::from(count as u32);
            beyond += usize::from(off.abs() > 3.0);
        }
        // The lowest point of N^2 / tau + K^2 tau / 3.
        let lowest = (2.0 * white * dt.sqrt() * walk / 3_f64.sqrt()).sqrt();
        floors += usize::from(found.floor_seen && (found.floor / lowest - 1.0).abs() < 0.25);
    }
    assert!(squares.iter().all(|mean| (0.2..2.5).contains(mean)), "{squares:?}");
    assert!(floors >= 55, "{floors} of {count}");
    assert!(beyond <= 4, "{beyond} of 120 beyond three deviations");
}
