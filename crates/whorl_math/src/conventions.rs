//! Pins the conventions page with numbers worked out by hand: what this crate computes of it. Signs of gravity,
//! accelerations and mass properties are pinned where they are computed, in `whorl_dynamics::validation::conventions`.

use crate::{attitude_error, azimuth_rad, elevation_x_rad, integrate_rate, vertical_b};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_6};

const TOLERANCE: f64 = 1e-14;

fn yaw(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

#[test]
fn quaternion_is_hamilton_and_active() {
    let i = Quaternion::new(0.0, 1.0, 0.0, 0.0);
    let j = Quaternion::new(0.0, 0.0, 1.0, 0.0);
    assert_eq!(i * j, Quaternion::new(0.0, 0.0, 0.0, 1.0));
    // A body yawed by +90 degrees (east to north) has its nose to the north.
    let nose_world = yaw(FRAC_PI_2) * Vector3::x();
    assert!((nose_world - Vector3::y()).norm() < TOLERANCE);
    assert!((azimuth_rad(&yaw(FRAC_PI_2)) - FRAC_PI_2).abs() < TOLERANCE);
}

#[test]
fn rate_is_in_body_axes() {
    // Body rolled by 90 degrees: body z lies along world -y. Turning about body z for a
    // quarter turn at 1 rad/s is a turn about world -y: the nose (east) goes up.
    let rolled = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    assert!((rolled * Vector3::z() + Vector3::y()).norm() < TOLERANCE);
    let after = integrate_rate(&rolled, &Vector3::z(), FRAC_PI_2);
    assert!((after * Vector3::x() - Vector3::z()).norm() < TOLERANCE);
}

#[test]
fn pitch_is_positive_nose_down() {
    let pitched = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.1);
    assert!((elevation_x_rad(&pitched) + 0.1).abs() < TOLERANCE);
}

#[test]
fn the_vertical_in_body_axes_is_where_up_is() {
    // Nose up: the body's x axis points up.
    let nose_up = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2);
    assert!((vertical_b(&nose_up) - Vector3::x()).norm() < TOLERANCE);
    // Rolled by 30 degrees: the left side (y) went up, to cos 60 = 1/2 of the vertical.
    let rolled = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_6);
    assert!((vertical_b(&rolled) - Vector3::new(0.0, 0.5, 0.75_f64.sqrt())).norm() < TOLERANCE);
}

#[test]
fn attitude_error_turns_reference_into_actual() {
    let error = attitude_error(&yaw(0.3), &yaw(0.5));
    assert!((error - Vector3::new(0.0, 0.0, 0.2)).norm() < TOLERANCE);
}
