//! Pendulum, precession, momentum exchange.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::special_functions::complete_elliptic_k;
use super::{free_platform, ns, plant, set_mass, start};
use crate::{InitialState, MassProperties};

/// Period of a compound pendulum about x from release at rest, by its zero crossings.
fn pendulum_period_s(amplitude_rad: f64) -> f64 {
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0))), Vector3::z() * -2.0);
    let initial = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(amplitude_rad, 0.0, 0.3),
        ..InitialState::default()
    };
    let mut p = plant(&model, &initial);
    let roll = |p: &crate::Plant| p.state().q_world_body.euler_angles().0;
    let (mut before, mut crossings) = (roll(&p), Vec::new());
    let mut k = 0;
    while crossings.len() < 5 {
        k += 1;
        p.advance_to(k * 1_000_000).unwrap();
        let now = roll(&p);
        if before * now < 0.0 {
            crossings.push((k as f64 - now / (now - before)) * 1e-3);
        }
        before = now;
    }
    (crossings[4] - crossings[0]) / 2.0
}

/// Small swings: T = 2 pi sqrt(I / m g r).
#[test]
fn small_pendulum_has_its_textbook_period() {
    let expected = TAU * (6.0_f64 / 2.0).sqrt();
    let period = pendulum_period_s(1e-4);
    assert!((period / expected - 1.0).abs() < 1e-8, "{period} {expected}");
}

/// Large swings: T = 4 sqrt(I / m g r) K(sin^2(a/2)).
#[test]
fn large_pendulum_has_the_elliptic_period() {
    for amplitude in [0.5_f64, 1.2, 2.5] {
        let expected = 4.0 * (6.0_f64 / 2.0).sqrt() * complete_elliptic_k((0.5 * amplitude).sin().powi(2));
        let period = pendulum_period_s(amplitude);
        assert!((period / expected - 1.0).abs() < 1e-7, "{amplitude}: {period} {expected}");
    }
}

/// Axisymmetric gyrostat with its wheel along the symmetry axis: the body rate turns about it at
/// ((It - Ia) w3 - J Om) / It in body axes (from Euler's equations with h3 = Ia w3 + J Om).
#[test]
fn gyrostat_precesses_as_in_closed_form() {
    let (transverse, axial, speed, spin) = (6.0, 10.0, 150.0, 0.4);
    let mut model = free_platform();
    model.wheels_mut().retain(|wheel| wheel.name == "wheel_z");
    let inertia = Matrix3::from_diagonal(&Vector3::new(transverse, transverse, axial));
    set_mass(&mut model, Some(inertia), Vector3::zeros());
    let wheel_momentum = model.wheels()[0].spin_inertia_kg_m2 * speed;
    let mut p = plant(&model, &start(Vector3::new(0.2, 0.0, spin), &[speed]));
    let rate = ((transverse - axial) * spin - wheel_momentum) / transverse;
    for k in 1..=20 {
        let t = f64::from(k);
        p.advance_to(ns(t)).unwrap();
        // dw1/dt = rate w2, dw2/dt = -rate w1.
        let expected = Vector3::new(0.2 * (rate * t).cos(), -0.2 * (rate * t).sin(), spin);
        let error = (p.state().omega_wb_b_rad_s - expected).norm();
        assert!(error < 1e-10, "at {t} s: {error}");
        // A free wheel keeps its speed relative to the body here, as w3 is constant.
        assert!((p.state().wheel_speed_rad_s()[0] - speed).abs() < 1e-9);
    }
}

/// A level top that spins fast about the vertical symmetry axis, tilted and released with the steady
/// precession rate, keeps its tilt: the rates solve It P^2 cos(th) - Ia n P + ... = torque.
#[test]
fn steady_precession_of_a_heavy_gyrostat_keeps_the_tilt() {
    // Fixed point, symmetric about body z, m g l above the pivot: with constant tilt th, precession
    // P about the vertical and h3 the momentum about body z,
    // h3 P sin(th) - It P^2 sin(th) cos(th) = m g l sin(th).
    let (transverse, axial, mgl, tilt, precession): (f64, f64, f64, f64, f64) = (6.0, 10.0, 2.0, 0.3, 0.5);
    let mut model = free_platform();
    model.wheels_mut().retain(|wheel| wheel.name == "wheel_z");
    let inertia = Matrix3::from_diagonal(&Vector3::new(transverse, transverse, axial));
    model.mass_properties = MassProperties::new(inertia, Vector3::z() * mgl, 50.0).unwrap();
    let h3 = mgl / precession + transverse * precession * tilt.cos();
    // Body rate: precession about the vertical only; the wheel carries the rest of h3.
    let q = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt);
    let omega = q.inverse() * Vector3::z() * precession;
    let speed = (h3 - axial * omega.z) / model.wheels()[0].spin_inertia_kg_m2;
    let initial = InitialState {
        q_world_body: q,
        omega_wb_b_rad_s: omega,
        wheel_speed_rad_s: vec![speed],
        ..InitialState::default()
    };
    let mut p = plant(&model, &initial);
    for k in 1..=20 {
        let t = f64::from(k);
        p.advance_to(ns(t)).unwrap();
        let expected = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), precession * t) * q;
        let error = p.state().q_world_body.angle_to(&expected);
        assert!(error < 1e-7, "at {t} s: {error}");
    }
}

/// Spinning a wheel up at constant torque u turns the body back: about a principal axis,
/// dw = -u t / (I - J) and dOm = u t / J + u t / (I - J).
#[test]
fn wheel_spin_up_exchanges_momentum_with_the_body() {
    let mut model = free_platform();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0))), Vector3::zeros());
    let inertia = model.wheels()[2].spin_inertia_kg_m2;
    let mut p = plant(&model, &InitialState::default());
    p.command_wheels(&[0.0, 0.0, 0.3]).unwrap();
    p.advance_to(ns(10.0)).unwrap();
    let omega = -0.3 * 10.0 / (12.0 - inertia);
    assert!((p.state().omega_wb_b_rad_s - Vector3::z() * omega).norm() < 1e-11);
    assert!((p.state().wheel_speed_rad_s()[2] - (0.3 * 10.0 / inertia - omega)).abs() < 1e-9);
    assert!(p.truth().momentum_b_n_m_s.norm() < 1e-11, "no momentum came from outside");
}

#[test]
fn a_torque_from_outside_turns_the_body_and_a_new_motion_starts_where_it_is_put() {
    let model = free_platform();
    let mut plant = plant(&model, &InitialState::default());
    plant.set_body_torque(Vector3::new(0.0, 0.0, 0.1));
    plant.advance_to(ns(2.0)).expect("advances");
    // I w + A J Om = g t for a body at rest before, wheels without friction.
    let momentum = plant.truth().momentum_b_n_m_s;
    assert!((momentum - Vector3::new(0.0, 0.0, 0.2)).norm() < 1e-3, "{momentum}");
    let q = UnitQuaternion::from_euler_angles(0.05, 0.0, 1.0);
    plant.set_motion(&q, &Vector3::new(0.1, 0.0, 0.0), &[5.0, 0.0, -3.0]).expect("three wheels");
    let truth = plant.truth();
    assert_eq!((truth.time_ns, truth.q_world_body), (ns(2.0), q));
    assert_eq!(truth.wheel_speed_rad_s, [5.0, 0.0, -3.0]);
    assert!(plant.set_motion(&q, &Vector3::zeros(), &[0.0]).is_err());
    assert!(plant.set_motion(&q, &Vector3::new(f64::NAN, 0.0, 0.0), &[0.0; 3]).is_err());
    assert_eq!(plant.truth(), truth, "unchanged");
}
