//! Sensors that contradict each other.

use super::{FreeMotionEstimator, FreeMotionParameters};
use nalgebra::{UnitQuaternion, Vector3};
use rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use whorl_math::rotation_vector;

/// A level sensor that turns about the vertical at `rate_z` [rad/s] and sees `field` in the world: gyro and accelerometer at
/// 100 Hz, magnetometer at 20 Hz. Gives yaw and its standard deviation \[deg\] and the bias about z [deg/s] each second.
fn level(
    seconds: i64,
    rate_z: impl Fn(f64) -> f64,
    field: impl Fn(f64) -> Option<Vector3<f64>>,
    range: f64,
) -> (Vec<[f64; 3]>, FreeMotionEstimator) {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut normal3 = |sigma: f64| {
        Vector3::from_fn(|_, _| {
            let value: f64 = StandardNormal.sample(&mut rng);
            value * sigma
        })
    };
    let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
    let (mut yaw, mut found) = (0.0, Vec::new());
    for i in 0..seconds * 100 {
        let t = i as f64 * 0.01;
        yaw += rate_z(t) * 0.01;
        let q = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
        let gyro = Vector3::z() * rate_z(t) + normal3(9e-4);
        let gyro = gyro.map(|rate| rate.clamp(-range, range));
        estimator.on_imu(i * 10_000_000, &gyro, &(Vector3::z() * 9.81 + normal3(0.03)));
        if let Some(field) = field(t).filter(|_| i % 5 == 0) {
            estimator.on_magnetometer(&(q.inverse() * field + normal3(0.2)));
        }
        if i % 100 == 99 {
            let estimate = estimator.estimate().expect("started");
            let off = rotation_vector(&(q.inverse() * estimate.q_world_body)).z.to_degrees();
            let bias = estimate.gyro_bias_rad_s.z.to_degrees();
            found.push([off, estimate.sigma_rad.z.to_degrees(), bias]);
        }
    }
    (found, estimator)
}

fn still(_: f64) -> Option<Vector3<f64>> {
    Some(Vector3::new(0.0, 20.0, -40.0))
}

/// From the heading of the first seconds.
fn drift(found: &[[f64; 3]]) -> f64 {
    let first = found[5][0];
    found[6..].iter().map(|[off, ..]| (off - first).abs()).fold(0.0, f64::max)
}

#[test]
fn a_magnet_that_passes_a_resting_sensor_does_not_turn_its_heading() {
    for magnet in
        [Vector3::new(-26.0, -5.0, 5.0), Vector3::new(3.0, 1.0, 0.0), Vector3::new(0.0, -12.0, 20.0)]
    {
        let passing = |t: f64| {
            let near = if (30.0..47.0).contains(&t) {
                ((t - 30.0) / 2.0).min((47.0 - t) / 2.0).min(1.0)
            } else {
                0.0
            };
            Some(Vector3::new(0.0, 20.0, -40.0) + magnet * near)
        };
        let (found, _) = level(80, |_| 0.0, passing, 10.0);
        assert!(drift(&found) < 0.5, "{magnet:?}: {}", drift(&found));
    }
}

#[test]
fn a_slow_smooth_turn_is_no_rest_and_its_rate_no_bias() {
    // Two turns in 40 s each, from standstill and back; the sensor rests for 10 s before, or begins to turn at once.
    for first_s in [10.0, 0.0] {
        let turn = |t: f64| {
            let since = t - first_s;
            let turns = (0.0..80.0).contains(&since);
            if turns {
                9_f64.to_radians() * (1.0 - (std::f64::consts::TAU * since / 40.0).cos())
            } else {
                0.0
            }
        };
        let (found, _) = level(100, turn, still, 10.0);
        let worst = found[5..].iter().map(|[off, sigma, _]| off.abs() / sigma).fold(0.0, f64::max);
        let bias = found[5..].iter().map(|[.., bias]| bias.abs()).fold(0.0, f64::max);
        // One that turns from the start on has no bias to compare with until the field has turned by 3 deg.
        let (most, furthest) = if first_s > 0.0 { (1.0, 2.0) } else { (3.0, 8.0) };
        assert!(worst < most && drift(&found) < furthest, "{worst} {}", drift(&found));
        assert!(bias < if first_s > 0.0 { 0.1 } else { 0.7 }, "{bias}");
        assert!(found[99][2].abs() < 0.1, "{:?}", found[99]);
    }
}

#[test]
fn a_resting_sensor_with_a_bias_rests_all_the_same() {
    // The gyro's bias jumps while it lies there: the field says that it does not turn.
    let jump = |t: f64| if t < 30.0 { 0.0 } else { 0.02 };
    let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
    for i in 0..8000_i64 {
        let wiggle = 1e-3 * (i as f64 * 1.7).sin();
        let gyro = Vector3::new(wiggle, wiggle, jump(i as f64 * 0.01) + wiggle);
        estimator.on_imu(i * 10_000_000, &gyro, &(Vector3::z() * 9.81));
        if i % 5 == 0 {
            estimator.on_magnetometer(&Vector3::new(0.0, 20.0 + 10.0 * wiggle, -40.0));
        }
    }
    let estimate = estimator.estimate().expect("started");
    let yaw = rotation_vector(&estimate.q_world_body).z.to_degrees();
    assert!(
        estimate.resting && (estimate.gyro_bias_rad_s.z - 0.02).abs() < 1e-3,
        "{:?}",
        estimate.gyro_bias_rad_s
    );
    assert!(yaw.abs() < 6.0, "{yaw}");
}

#[test]
fn samples_at_the_end_of_the_range_are_counted_and_make_the_heading_uncertain() {
    // Half a second up to 250 deg/s with a range of 125 deg/s: 20 deg are not measured.
    let quick = |t: f64| {
        let since = t - 20.0;
        let turns = (0.0..0.5).contains(&since);
        if turns { 125_f64.to_radians() * (1.0 - (std::f64::consts::TAU * since / 0.5).cos()) } else { 0.0 }
    };
    let at_start = |t: f64| still(t).filter(|_| t < 10.0);
    let (found, estimator) = level(40, quick, at_start, 125_f64.to_radians());
    let [off, sigma, _] = found[39];
    assert!(off.abs() > 15.0 && off.abs() < 2.0 * sigma && sigma < 60.0, "{off} {sigma}");
    assert!(found[15][1] < 6.0, "{:?}", found[15]);
    let doubts = estimator.doubts();
    assert!(
        doubts[0].contains("samples of the gyro stand at the end of its range (125.0 deg/s)"),
        "{doubts:?}"
    );
    // With a field that goes on it comes back.
    let (found, _) = level(40, quick, still, 125_f64.to_radians());
    assert!(found[39][0].abs() < 3.0, "{:?}", found[39]);
}

#[test]
fn a_mirrored_magnetometer_is_named_and_left_out() {
    let q_of = |t: f64| if (10.0..18.0).contains(&t) { 45_f64.to_radians() } else { 0.0 };
    let mirrored = |t: f64| {
        // The field that a sensor with y reversed would have to be in: turned back twice as far.
        let yaw: f64 = q_of(11.0) * (t - 10.0).clamp(0.0, 8.0);
        let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, 2.0 * yaw) * Vector3::new(0.0, -20.0, -40.0);
        Some(turned)
    };
    let (found, estimator) = level(40, q_of, mirrored, 10.0);
    let [off, sigma, _] = found[39];
    let doubts = estimator.doubts();
    assert!(
        doubts[0].contains("magnetometer turns against the gyro: its axis x or y is reversed"),
        "{doubts:?}"
    );
    assert!((off - found[9][0]).abs() < 2.0 && sigma > 90.0, "{off} {sigma} {:?}", found[9]);
}
