//! Sensors and surroundings that are worse than usual: the error stays within what is stated of it.

use nalgebra::Vector3;

use super::FreeMotionEstimator;
use super::orientation_error::orientation_error;
use super::tests::{Conditions, Sample, record, usual};
use crate::FreeMotionParameters;

/// After each sample from `from_s` on: time \[s\], heading error and its stated standard deviation \[deg\].
fn headings(samples: &[Sample], from_s: f64, has_field: bool) -> (Vec<[f64; 3]>, FreeMotionEstimator) {
    let mut estimator = FreeMotionEstimator::new(FreeMotionParameters::default());
    let mut found = Vec::new();
    for sample in samples {
        estimator.on_imu(sample.stamp_ns, &sample.gyro, &sample.force);
        if has_field {
            estimator.on_magnetometer(&sample.field);
        }
        let time_s = sample.stamp_ns as f64 * 1e-9;
        if let Some(estimate) = estimator.estimate().filter(|_| time_s >= from_s) {
            let [_, heading, _] = orientation_error(&estimate.q_world_body, &sample.truth);
            found.push([time_s, heading.to_degrees(), estimate.sigma_rad.z.to_degrees()]);
        }
    }
    (found, estimator)
}

fn worst(found: &[[f64; 3]]) -> f64 {
    found.iter().map(|[_, error, _]| error.abs()).fold(0.0, f64::max)
}

/// In stated standard deviations.
fn furthest(found: &[[f64; 3]]) -> f64 {
    found.iter().map(|[_, error, sigma]| error.abs() / sigma).fold(0.0, f64::max)
}

#[test]
fn a_gyro_that_reads_low_or_high_is_found_out() {
    for gyro_scale in [-0.128, -0.05, 0.05, 0.1] {
        let samples = record(60.0, &Conditions { gyro_scale, ..usual() }, 5);
        let (found, _) = headings(&samples, 1.0, true);
        assert!(furthest(&found) < 3.0, "{gyro_scale}: {} deviations", furthest(&found));
        let late: Vec<[f64; 3]> = found.into_iter().filter(|[t, ..]| *t > 40.0).collect();
        assert!(worst(&late) < 4.0, "{gyro_scale}: {} deg", worst(&late));
    }
}

/// The sensor rests while a magnet comes and goes, and then moves in the field of the start: what the magnet did to the field says
/// nothing of where the sensor is later.
#[test]
fn a_magnet_that_was_there_at_rest_costs_no_trust_in_the_field_later() {
    let mut samples = record(120.0, &Conditions { gyro_scale: 0.01, ..usual() }, 8);
    for sample in samples.iter_mut().filter(|s| (6_000_000_000..10_500_000_000).contains(&s.stamp_ns)) {
        sample.field += sample.truth.inverse() * Vector3::new(6.0, 2.0, -25.0);
    }
    let (found, _) = headings(&samples, 12.0, true);
    assert!(worst(&found) < 3.0 && furthest(&found) < 3.0, "{} deg", worst(&found));
}

/// Iron of twice the field lies beside the sensor and is taken away before it moves.
#[test]
fn a_start_beside_iron_that_is_taken_away_is_said_to_be_uncertain() {
    let mut samples = record(60.0, &usual(), 9);
    for sample in samples.iter_mut().filter(|s| s.stamp_ns < 4_000_000_000) {
        sample.field += sample.truth.inverse() * Vector3::new(60.0, 50.0, 40.0);
    }
    let (found, _) = headings(&samples, 5.0, true);
    assert!(worst(&found) > 20.0 && furthest(&found) < 3.0, "{} deviations", furthest(&found));
    let (at_end, _) = found.split_last().expect("samples");
    assert!(at_end[1].abs() < 8.0, "{at_end:?}");
}

/// Without a magnetometer; the sensor rests before, in and behind the gap.
#[test]
fn a_gap_at_rest_keeps_the_heading_and_says_what_may_have_happened_in_it() {
    let conditions = Conditions { motion: 0.0, ..usual() };
    let mut samples = record(40.0, &conditions, 4);
    // It begins askew and is turned about the vertical by 90 deg in the fifth second.
    let turn = std::f64::consts::FRAC_PI_2;
    for sample in &mut samples {
        let t = sample.stamp_ns as f64 * 1e-9;
        let turned = turn * (t - 5.0).clamp(0.0, 1.0);
        sample.truth = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, turned);
        sample.gyro.z += if (5.0..6.0).contains(&t) { turn } else { 0.0 };
    }
    samples.retain(|s| !(20_000_000_000..23_000_000_000).contains(&s.stamp_ns));
    let (found, estimator) = headings(&samples, 7.0, false);
    let off = |t: f64| found.iter().find(|[time_s, ..]| *time_s >= t).expect("it runs")[1];
    assert!((off(30.0) - off(19.0)).abs() < 1.0, "{} {}", off(19.0), off(30.0));
    let sigma = |t: f64| found.iter().find(|[time_s, ..]| *time_s >= t).expect("it runs")[2];
    assert!(sigma(30.0) >= 80.0, "{}", sigma(30.0));
    assert!(
        estimator
            .doubts()
            .iter()
            .any(|doubt| doubt.contains("1 gaps of more than a second, the longest 3.0 s"))
    );
}

/// All three signs of the accelerometer are reversed: it reads gravity.
#[test]
fn an_accelerometer_upside_down_is_told_by_the_field() {
    let mut samples = record(20.0, &usual(), 6);
    let (_, right) = headings(&samples, 1.0, true);
    assert!(right.doubts().is_empty(), "{:?}", right.doubts());
    samples.iter_mut().for_each(|sample| sample.force = -sample.force);
    let (_, wrong) = headings(&samples, 1.0, true);
    assert!(
        wrong.doubts().iter().any(|doubt| doubt.contains("69 deg above the horizon")),
        "{:?}",
        wrong.doubts()
    );
}
