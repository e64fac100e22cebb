//! A hand-held sensor in closed form: angles and position are sums of sines.

use super::covariance::{
    ATTITUDE, Covariance, FORCE_BIAS, GYRO_BIAS, GYRO_MATRIX, Interval, POSITION, Row, STATES, VELOCITY,
    propagate, transition,
};
use super::{FreeMotionEstimator, FreeMotionFilter, FreeMotionParameters};
use crate::OrientationErrors;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use whorl_estimation::{Estimator, FilterKind, ImuSample, Parameters};
use whorl_math::{quaternion_exp, rotation_vector};

const RATE_HZ: f64 = 200.0;
const FIELD: [f64; 3] = [0.0, 15.0, -40.0];

/// What is wrong with the sensor and its surroundings.
#[derive(Clone, Copy, Default)]
pub(super) struct Conditions {
    /// Rotation and translation, relative to a brisk motion of the hand.
    pub motion: f64,
    pub noise: f64,
    pub gyro_bias: Vector3<f64>,
    pub gyro_scale: f64,
    pub force_bias: Vector3<f64>,
    pub magnet: Vector3<f64>,
    /// East component that the field gains while a magnet is near, from 40 s to 60 s.
    pub passing_magnet: f64,
    /// Additional field where the sensor moves, compared with where it lay.
    pub elsewhere: Vector3<f64>,
    /// Additional field until the sensor moves.
    pub at_start: Vector3<f64>,
    /// When the sensor comes back to rest where it lay \[s\]; 0: never.
    pub back_s: f64,
}

pub(super) struct Sample {
    pub stamp_ns: i64,
    pub gyro: Vector3<f64>,
    pub force: Vector3<f64>,
    pub field: Vector3<f64>,
    pub truth: UnitQuaternion<f64>,
    pub scored: bool,
}

/// Motion after 10 s of rest.
fn envelope(t: f64, back_s: f64) -> f64 {
    let leaving = ((t - 10.0) / 2.0).clamp(0.0, 1.0);
    if back_s > 0.0 { leaving.min(((back_s - t) / 2.0).clamp(0.0, 1.0)) } else { leaving }
}

fn attitude(t: f64, motion: f64) -> UnitQuaternion<f64> {
    attitude_until(t, motion, 0.0)
}

fn attitude_until(t: f64, motion: f64, back_s: f64) -> UnitQuaternion<f64> {
    let e = motion * envelope(t, back_s);
    let yaw = 0.4 + e * (1.3 * (0.9 * t).sin() + 0.8 * (0.23 * t).sin());
    let pitch = e * (0.9 * (1.3 * t).sin() + 0.3 * (2.9 * t).cos());
    let roll = e * (1.2 * (1.1 * t + 0.5).sin() + 0.5 * (0.31 * t).sin());
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

fn position(t: f64, motion: f64, back_s: f64) -> Vector3<f64> {
    let e = motion * envelope(t, back_s);
    Vector3::new(0.3 * (1.9 * t).sin(), 0.25 * (2.3 * t).sin(), 0.15 * (2.9 * t).cos()) * e
}

pub(super) fn record(seconds: f64, conditions: &Conditions, seed: u64) -> Vec<Sample> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut normal3 = |sigma: f64| {
        Vector3::from_fn(|_, _| {
            let value: f64 = StandardNormal.sample(&mut rng);
            value * sigma
        })
    };
    let (motion, noise, back_s) = (conditions.motion, conditions.noise, conditions.back_s);
    let attitude = |t: f64, motion: f64| attitude_until(t, motion, back_s);
    (0..(seconds * RATE_HZ) as i64)
        .map(|k| {
            let t = k as f64 / RATE_HZ;
            let d = 1e-4;
            let q = attitude(t, motion);
            // Means over the interval that ends with the sample, as digital inertial units give them.
            let interval = 1.0 / RATE_HZ;
            let rate =
                rotation_vector(&(attitude(t - interval, motion).inverse() * attitude(t, motion))) / interval;
            let velocity =
                |t: f64| (position(t + d, motion, back_s) - position(t - d, motion, back_s)) / (2.0 * d);
            let acceleration = (velocity(t) - velocity(t - interval)) / interval;
            let middle = attitude(t - 0.5 * interval, motion);
            let mut field = Vector3::from(FIELD) + conditions.elsewhere * envelope(t, back_s);
            if t < 11.0 {
                field += conditions.at_start;
            }
            if (40.0..60.0).contains(&t) {
                field += Vector3::new(1.0, 0.5, 0.5) * conditions.passing_magnet;
            }
            Sample {
                stamp_ns: (t * 1e9) as i64,
                gyro: rate * (1.0 + conditions.gyro_scale) + conditions.gyro_bias + normal3(3e-3 * noise),
                force: middle.inverse() * (acceleration + Vector3::z() * 9.81)
                    + conditions.force_bias
                    + normal3(0.03 * noise),
                field: q.inverse() * field + conditions.magnet + normal3(0.5 * noise),
                truth: q,
                scored: t > 15.0,
            }
        })
        .collect()
}

/// RMS errors \[deg\]: total, heading, inclination; and the estimator at the end.
fn run(samples: &[Sample]) -> ([f64; 3], FreeMotionEstimator) {
    let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
    let mut errors = OrientationErrors::default();
    for sample in samples {
        estimator.on_imu(sample.stamp_ns, &sample.gyro, &sample.force);
        estimator.on_magnetometer(&sample.field);
        if let Some(estimate) = estimator.estimate().filter(|_| sample.scored) {
            errors.add(&estimate.q_world_body, &sample.truth);
        }
    }
    (errors.root_mean_square_rad().expect("scored samples").map(f64::to_degrees), estimator)
}

pub(super) fn usual() -> Conditions {
    Conditions {
        motion: 1.0,
        noise: 1.0,
        gyro_bias: Vector3::new(0.004, -0.006, 0.008),
        gyro_scale: 0.004,
        force_bias: Vector3::new(0.03, -0.02, 0.04),
        ..Conditions::default()
    }
}

#[test]
fn a_perfect_sensor_is_followed_but_for_its_own_acceleration() {
    let perfect = Conditions { motion: 1.0, ..Conditions::default() };
    let ([total, ..], _) = run(&record(60.0, &perfect, 1));
    // Measured 0.53: swings of 0.3 m at 2 rad/s are a tenth of gravity, which the filter cannot tell from a tilt.
    assert!(total < 0.6, "{total}");
}

#[test]
fn brisk_motion_with_a_usual_sensor() {
    let ([_, heading, inclination], estimator) = run(&record(90.0, &usual(), 2));
    // The accelerometer's bias is 0.2 deg of inclination at the start; the motion itself makes as much.
    assert!(inclination < 0.52, "inclination {inclination}");
    assert!(heading < 1.0, "heading {heading}");
    let estimate = estimator.estimate().expect("running");
    assert!((estimate.gyro_bias_rad_s - usual().gyro_bias).norm() < 1e-3, "{}", estimate.gyro_bias_rad_s);
    assert!(!estimator.is_magnetised());
}

#[test]
fn a_magnet_on_the_sensor_is_found_and_taken_away() {
    // The last is stronger than the Earth's field and turns the first heading by half a turn.
    for (magnet, within_deg) in [
        (Vector3::new(4.0, -3.0, 4.0), 1.2),
        (Vector3::new(12.0, -8.0, 9.0), 2.1),
        (Vector3::new(10.0, -40.0, 20.0), 4.2),
    ] {
        let (_, estimator) = run(&record(60.0, &Conditions { magnet, ..usual() }, 3));
        assert!(estimator.is_magnetised(), "{magnet}");
        let estimate = estimator.estimate().expect("running");
        assert!(
            (estimate.iron_magnetometer_unit - magnet).norm() < 1.0,
            "{magnet}: {}",
            estimate.iron_magnetometer_unit
        );
        let truth = attitude(60.0 - 1.0 / RATE_HZ, 1.0);
        let [_, heading, _] = crate::orientation_error::orientation_error(&estimate.q_world_body, &truth);
        assert!(heading.to_degrees().abs() < within_deg, "{magnet}: {}", heading.to_degrees());
    }
}

#[test]
fn the_heading_is_that_of_the_start_where_the_field_is_another() {
    // The steel of a table: 8 deg of azimuth, a tenth of the length.
    let elsewhere = Vector3::new(-2.5, 2.5, -3.0);
    let ([_, heading, _], estimator) = run(&record(90.0, &Conditions { elsewhere, ..usual() }, 7));
    assert!(heading < 1.3, "heading {heading}");
    assert!(!estimator.is_magnetised());
}

/// From the whole recording: the inclination is better than from the past, and the heading is right before a magnet on the
/// sensor is found. (The simulated start shows north exactly: what is known of it later makes the heading no better.)
#[test]
fn smoothing_beats_the_filter_and_knows_the_magnet_from_the_start() {
    for (magnet, times) in [(Vector3::zeros(), 0.9), (Vector3::new(10.0, -40.0, 20.0), 3.0)] {
        let conditions = Conditions { magnet, gyro_scale: 0.01, back_s: 85.0, ..usual() };
        let recorded = record(95.0, &conditions, 11);
        let samples: Vec<crate::Sample> = recorded
            .iter()
            .map(|s| crate::Sample {
                stamp_ns: s.stamp_ns,
                gyro_rad_s: s.gyro,
                force_m_s2: Some(s.force),
                vectors: vec![Some(crate::Observed { body: s.field, reference_w: None })],
            })
            .collect();
        let crate::Smoothed { orientations: smoothed, is_magnetised: magnetised, .. } =
            crate::smooth_free_motion(FreeMotionParameters::default(), &samples);
        let causal = crate::forward(&mut FreeMotionEstimator::new(FreeMotionParameters::default()), &samples);
        let total = |found: &[Option<crate::Orientation>]| {
            let mut errors = OrientationErrors::default();
            for (sample, estimate) in recorded.iter().zip(found).filter(|(s, _)| s.scored) {
                errors.add(&estimate.expect("running").q_world_body, &sample.truth);
            }
            errors.root_mean_square_rad().expect("scored").map(f64::to_degrees)
        };
        let ([of_smoothed, _, tilted], [of_causal, _, causally_tilted]) = (total(&smoothed), total(&causal));
        assert!(tilted < 0.8 * causally_tilted, "{magnet}: {tilted} {causally_tilted}");
        assert_eq!(magnetised, magnet.norm() > 0.0);
        assert!(of_smoothed * times < of_causal, "{magnet}: {of_smoothed} {of_causal}");
    }
}

#[test]
fn a_magnet_passed_by_hardly_turns_the_heading() {
    // 15 uT to the east turn the field by 40 deg.
    let ([_, heading, _], _) = run(&record(90.0, &Conditions { passing_magnet: 15.0, ..usual() }, 4));
    assert!(heading < 1.1, "heading {heading}");
}

/// A gyro with 2 % of scale error loses the heading while a magnet passes; back at rest in the start's field it is found.
#[test]
fn a_lost_heading_is_found_where_the_start_was() {
    let conditions = Conditions {
        gyro_scale: 0.02,
        passing_magnet: 30.0,
        elsewhere: Vector3::new(6.0, 2.0, -3.0),
        back_s: 70.0,
        ..usual()
    };
    let samples = record(90.0, &conditions, 8);
    let heading_at = |end_s: f64| {
        let count = (end_s * RATE_HZ) as usize;
        let (_, estimator) = run(&samples[..count]);
        let q = estimator.estimate().expect("running").q_world_body;
        let [_, heading, _] = crate::orientation_error(&q, &samples[count - 1].truth);
        heading.to_degrees().abs()
    };
    let (moving, back) = (heading_at(67.0), heading_at(90.0));
    assert!(moving > 2.5 && back < 1.5, "{moving} {back}");
}

/// 20 uT to the east: 53 deg of azimuth, half the field's length. A minute in motion shows that it was the start's alone.
#[test]
fn a_start_beside_a_magnet_is_not_north_for_ever() {
    let conditions = Conditions { at_start: Vector3::new(20.0, 5.0, 5.0), ..usual() };
    let (_, estimator) = run(&record(140.0, &conditions, 9));
    let q = estimator.estimate().expect("running").q_world_body;
    let truth = attitude(140.0 - 1.0 / RATE_HZ, 1.0);
    let [_, heading, _] = crate::orientation_error(&q, &truth);
    assert!(heading.to_degrees().abs() < 2.0, "{}", heading.to_degrees());
}

#[test]
fn without_a_magnetometer_the_inclination_is_as_good() {
    let mut filter = FreeMotionFilter::new(FreeMotionParameters::default());
    let mut errors = OrientationErrors::default();
    for sample in record(60.0, &usual(), 5) {
        filter.on_imu(sample.stamp_ns, &sample.gyro, &sample.force);
        if let Some(estimate) = filter.estimate().filter(|_| sample.scored) {
            errors.add(&estimate.q_world_body, &sample.truth);
        }
    }
    let [_, _, inclination] = errors.root_mean_square_rad().expect("scored").map(f64::to_degrees);
    assert!(inclination < 0.65, "{inclination}");
}

/// Behind the platforms' interface its samples are not gated by a filter that expects a fixed pivot.
#[test]
fn the_estimator_of_the_node_is_as_good() {
    let parameters = Parameters::freely_moving().with_magnetometer(std::f64::consts::FRAC_PI_2);
    let mut estimator = Estimator::new(FilterKind::FREE_MOTION, parameters, None).expect("allowed");
    let mut errors = OrientationErrors::default();
    for sample in record(90.0, &usual(), 2) {
        let (gyro_rad_s, specific_force_m_s2) = (sample.gyro, sample.force);
        estimator.on_imu(&ImuSample { stamp_ns: sample.stamp_ns, gyro_rad_s, specific_force_m_s2 });
        estimator.on_vector(sample.stamp_ns, &sample.field);
        if sample.scored {
            errors.add(&estimator.estimate(sample.stamp_ns).q_world_body, &sample.truth);
        }
    }
    let [_, heading, inclination] = errors.root_mean_square_rad().expect("scored").map(f64::to_degrees);
    assert!(inclination < 0.4 && heading < 0.65, "inclination {inclination}, heading {heading}");
}

#[test]
fn bad_samples_do_no_harm() {
    let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
    for (k, sample) in record(30.0, &usual(), 6).iter().enumerate() {
        let spoilt = Vector3::new(f64::NAN, 1.0, f64::INFINITY);
        if k % 7 == 0 {
            estimator.on_imu(sample.stamp_ns, &spoilt, &sample.force);
            estimator.on_magnetometer(&spoilt);
            estimator.on_magnetometer(&Vector3::zeros());
            estimator.on_imu(sample.stamp_ns - 1_000_000_000, &sample.gyro, &sample.force);
        }
        estimator.on_imu(sample.stamp_ns, &sample.gyro, &sample.force);
        estimator.on_magnetometer(&sample.field);
    }
    let estimate = estimator.estimate().expect("running");
    assert!(estimate.sigma_rad.iter().all(|s| s.is_finite()));
}

#[test]
fn the_growth_is_that_of_the_whole_matrix() {
    let seed = Covariance::from_fn(|i, j| ((i * 7 + j * 13) as f64).sin());
    let p = seed * seed.transpose();
    let block = |k: f64| Matrix3::from_fn(|i, j| (k + i as f64 + 2.0 * j as f64).cos());
    let interval = Interval {
        dt_s: 0.05,
        rotation_s: block(0.3) * 0.05,
        rotation_rate: [block(1.0) * 0.1, block(2.0) * 0.2, block(3.0) * 0.3],
        force_w_m_s: Vector3::new(0.1, -0.2, 0.5),
        east_left: 0.9,
        noise: Row::from_fn(|i, _| 0.01 * i as f64),
    };
    let f = transition(&interval);
    let expected = f * p * f.transpose() + Covariance::from_diagonal(&interval.noise);
    let mut grown = p;
    propagate(&mut grown, &interval);
    assert!((grown - expected).amax() < 1e-12 * expected.amax());
}

/// The transition matrix against differences of the motion itself, over an interval with turning and accelerating.
#[test]
fn transition_is_the_derivative_of_the_motion() {
    let (dt, steps) = (1e-3, 20);
    let gyro = |k: i32| Vector3::new(0.5, -1.0 + 0.01 * f64::from(k), 2.0);
    let force = |k: i32| Vector3::new(1.0, -2.0, 9.0 + 0.05 * f64::from(k));
    // Strapdown with the error state applied at the start; returns the end.
    let fly = |error: &Row| {
        let part = |at: usize| Vector3::from(error.fixed_rows::<3>(at));
        let matrix = Matrix3::from_row_iterator(error.fixed_rows::<9>(GYRO_MATRIX).iter().copied());
        let mut q = quaternion_exp(&part(ATTITUDE)) * UnitQuaternion::from_euler_angles(0.2, -0.4, 1.0);
        let (mut v, mut p) = (part(VELOCITY), part(POSITION));
        let mut sums = (Matrix3::zeros(), [Matrix3::zeros(); 3], Vector3::zeros());
        for k in 0..steps {
            let omega = gyro(k) + matrix * gyro(k) - part(GYRO_BIAS);
            let middle = q * quaternion_exp(&(omega * (0.5 * dt)));
            let rotation = *middle.to_rotation_matrix().matrix();
            let force_w = rotation * (force(k) - part(FORCE_BIAS));
            p += v * dt + force_w * (0.5 * dt * dt);
            v += force_w * dt;
            q *= quaternion_exp(&(omega * dt));
            sums.0 += rotation * dt;
            for (sum, rate) in sums.1.iter_mut().zip(gyro(k).iter()) {
                *sum += rotation * (rate * dt);
            }
            sums.2 += force_w * dt;
        }
        (q, v, p, sums)
    };
    let (q0, v0, p0, sums) = fly(&Row::zeros());
    let interval = Interval {
        dt_s: dt * f64::from(steps),
        rotation_s: sums.0,
        rotation_rate: sums.1,
        force_w_m_s: sums.2,
        east_left: 0.9,
        noise: Row::zeros(),
    };
    let f = transition(&interval);
    let inertial = (ATTITUDE..FORCE_BIAS + 3).chain(GYRO_MATRIX..STATES);
    for state in inertial {
        let step = 1e-6;
        let mut error = Row::zeros();
        error[state] = step;
        let (q, v, p, _) = fly(&error);
        let attitude = rotation_vector(&(q * q0.inverse())) / step;
        let expected = f.column(state);
        assert!((attitude - expected.fixed_rows::<3>(ATTITUDE)).norm() < 1e-4, "attitude, state {state}");
        // First order in the interval: second-order terms are of size dt^2 = 4e-4 times the force.
        assert!(
            ((v - v0) / step - expected.fixed_rows::<3>(VELOCITY)).norm() < 6e-3,
            "velocity, state {state}"
        );
        assert!(
            ((p - p0) / step - expected.fixed_rows::<3>(POSITION)).norm() < 3e-3,
            "position, state {state}"
        );
    }
}
