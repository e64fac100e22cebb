//! Pins the conventions page with numbers worked out by hand.

use crate::{GRAVITY_M_S2, attitude_error, azimuth_rad, elevation_x_rad, integrate_rate, vertical_b};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;

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
fn accelerometer_reads_plus_g_up_and_centripetal_inwards() {
    let level = UnitQuaternion::identity();
    assert_eq!(GRAVITY_M_S2 * vertical_b(&level), Vector3::new(0.0, 0.0, 9.81));
    // Nose up: the body's x axis points up and reads +g.
    let nose_up = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2);
    assert!((vertical_b(&nose_up) - Vector3::x()).norm() < TOLERANCE);
    // 2 rad/s about z, sensor at 0.5 m on x: 2^2 * 0.5 = 2 m/s^2 towards the axis.
    let (omega, r) = (Vector3::z() * 2.0, Vector3::x() * 0.5);
    assert_eq!(omega.cross(&omega.cross(&r)), Vector3::new(-2.0, 0.0, 0.0));
    // 3 rad/s^2 about z at the same place: +1.5 m/s^2 on y.
    assert_eq!((Vector3::z() * 3.0).cross(&r), Vector3::new(0.0, 1.5, 0.0));
}

#[test]
fn negative_mgr_z_is_pendulum_stable() {
    // Rolled by +0.1 rad with mgr = (0, 0, -2) N m: torque = mgr x (-R^T k) must push back.
    let rolled = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.1);
    let torque = Vector3::new(0.0, 0.0, -2.0).cross(&-vertical_b(&rolled));
    assert!((torque - Vector3::new(-2.0 * 0.1_f64.sin(), 0.0, 0.0)).norm() < TOLERANCE);
}

#[test]
fn inertia_products_are_matrix_elements() {
    // Two unit point masses at +-(1, 1, 0): I_xy as a matrix element is -sum m x y = -2.
    let inertia = [Vector3::new(1.0, 1.0, 0.0), Vector3::new(-1.0, -1.0, 0.0)]
        .iter()
        .map(|p| Matrix3::identity() * p.norm_squared() - p * p.transpose())
        .sum::<Matrix3<f64>>();
    assert_eq!(inertia[(0, 1)], -2.0);
    assert_eq!(inertia * Vector3::x(), Vector3::new(2.0, -2.0, 0.0));
}

#[test]
fn attitude_error_turns_reference_into_actual() {
    let error = attitude_error(&yaw(0.3), &yaw(0.5));
    assert!((error - Vector3::new(0.0, 0.0, 0.2)).norm() < TOLERANCE);
}
