//! Tests the conventions page on accelerations, gravity and mass properties (`whorl_math`), with numbers
//! worked out by hand.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::{free_platform, ns, plant, set_mass};
use crate::sensing::specific_force_b_m_s2;
use crate::{InitialState, PlatformModel};

const TOLERANCE: f64 = 1e-14;

/// Whorl-I without wheels, so that its inertia alone resists.
fn rigid(inertia_b_kg_m2: Matrix3<f64>, gravity_offset_b_n_m: Vector3<f64>) -> PlatformModel {
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(inertia_b_kg_m2), gravity_offset_b_n_m);
    model
}

/// Angular acceleration over the first millisecond from rest [rad/s^2].
fn acceleration_from_rest(model: &PlatformModel, q_world_body: UnitQuaternion<f64>) -> Vector3<f64> {
    let mut p = plant(model, &InitialState { q_world_body, ..InitialState::default() });
    p.advance_to(ns(1e-3)).unwrap();
    p.state().omega_wb_b_rad_s * 1e3
}

#[test]
fn accelerometer_reads_plus_g_on_the_axis_that_points_up() {
    let mut model = free_platform();
    let errors = &mut model.sensors.accelerometer.errors;
    (errors.noise_stddev, errors.bias_turn_on_stddev, errors.bias_walk) = Default::default();
    (errors.bias, errors.scale, errors.misalignment_rad) = Default::default();
    (errors.quantum, errors.range) = (0.0, 100.0);
    let reads = |q_world_body| {
        let initial = InitialState { q_world_body, ..InitialState::default() };
        plant(&model, &initial).sample_imu().specific_force_m_s2
    };
    let level = reads(UnitQuaternion::identity());
    assert!((level - Vector3::new(0.0, 0.0, 9.81)).norm() < TOLERANCE, "{level}");
    // Nose up is a negative pitch.
    let nose_up = reads(UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2));
    assert!((nose_up - Vector3::new(9.81, 0.0, 0.0)).norm() < TOLERANCE * 9.81, "{nose_up}");
}

#[test]
fn off_the_centre_it_feels_the_way_inwards_and_the_way_round() {
    // 2 rad/s about z at 0.5 m on x: 2^2 * 0.5 = 2 m/s^2 towards the axis. 3 rad/s^2 there: 1.5 m/s^2 on y.
    let felt = specific_force_b_m_s2(
        &Vector3::new(0.5, 0.0, 0.0),
        &Vector3::new(0.0, 0.0, 2.0),
        &Vector3::new(0.0, 0.0, 3.0),
        &Vector3::z(),
    );
    assert_eq!(felt, Vector3::new(-2.0, 1.5, 9.81));
}

#[test]
fn negative_mgr_z_is_pendulum_stable() {
    // Rolled by 30 degrees with mgr = (0, 0, -2) N m: 2 sin 30 = 1 N m pushes back, on 5 kg m^2.
    let model = rigid(Matrix3::from_diagonal(&Vector3::new(5.0, 7.0, 10.0)), Vector3::new(0.0, 0.0, -2.0));
    let rolled = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 30.0_f64.to_radians());
    let found = acceleration_from_rest(&model, rolled);
    assert!((found - Vector3::new(-0.2, 0.0, 0.0)).norm() < 1e-6, "{found}");
}

#[test]
fn mgr_points_to_the_centre_of_mass() {
    // Level, the centre of mass 0.6 N m to the nose: it falls, so the nose goes down, a positive pitch.
    let model = rigid(Matrix3::from_diagonal(&Vector3::new(5.0, 6.0, 10.0)), Vector3::new(0.6, 0.0, 0.0));
    let found = acceleration_from_rest(&model, UnitQuaternion::identity());
    assert!((found - Vector3::new(0.0, 0.1, 0.0)).norm() < 1e-6, "{found}");
}

#[test]
fn inertia_products_are_matrix_elements() {
    // Two point masses of 1 kg at +-(1, 1, 0) m and two of 0.5 kg at +-(1, -1, 0) m: I_xy as a matrix element
    // is -sum m x y = -2 + 1 = -1, the moments about x and y are 3, about z 6 kg m^2. The inverse has (3, 1) / 8.
    let inertia = Matrix3::new(3.0, -1.0, 0.0, -1.0, 3.0, 0.0, 0.0, 0.0, 6.0);
    let model = rigid(inertia, Vector3::new(0.0, 0.0, -1.6));
    // 30 degrees of roll: -0.8 N m about x.
    let rolled = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 30.0_f64.to_radians());
    let found = acceleration_from_rest(&model, rolled);
    assert!((found - Vector3::new(-0.3, -0.1, 0.0)).norm() < 1e-6, "{found}");
}
