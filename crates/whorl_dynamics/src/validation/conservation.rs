//! Energy and momentum.

use nalgebra::{Matrix3, Vector3};

use super::{free_platform, ns, plant, set_mass, start};

/// Torque-free tumbling with spinning wheels: momentum in the world and energy stay.
#[test]
fn torque_free_motion_keeps_momentum_in_the_world_and_energy() {
    let model = free_platform();
    let mut p = plant(&model, &start(Vector3::new(0.3, -0.5, 0.8), &[100.0, -50.0, 30.0]));
    let world = |p: &crate::Plant| p.state().q_world_body * p.truth().momentum_b_n_m_s;
    let energy = |p: &crate::Plant| {
        let s = p.state();
        p.gyrostat().kinetic_energy_j(&s.omega_wb_b_rad_s, s.wheel_speed_rad_s())
    };
    let (momentum_0, energy_0) = (world(&p), energy(&p));
    p.advance_to(ns(60.0)).unwrap();
    assert!(p.state().omega_wb_b_rad_s.norm() > 0.1, "it must move for the test to mean anything");
    assert!((world(&p) - momentum_0).norm() < 1e-9 * momentum_0.norm());
    assert!((energy(&p) / energy_0 - 1.0).abs() < 1e-10);
}

/// A heavy top keeps kinetic plus potential energy, and momentum about the vertical.
#[test]
fn heavy_top_keeps_total_energy_and_vertical_momentum() {
    let mut model = free_platform();
    set_mass(&mut model, None, Vector3::new(0.3, -0.2, -2.0));
    let mut p = plant(&model, &start(Vector3::new(0.3, -0.5, 0.8), &[100.0, -50.0, 30.0]));
    let invariants = |p: &crate::Plant| {
        let s = p.state();
        let kinetic = p.gyrostat().kinetic_energy_j(&s.omega_wb_b_rad_s, s.wheel_speed_rad_s());
        let momentum = s.q_world_body * p.truth().momentum_b_n_m_s;
        (kinetic + p.gyrostat().potential_energy_j(&s.q_world_body), momentum.z)
    };
    let (energy_0, vertical_0) = invariants(&p);
    p.advance_to(ns(60.0)).unwrap();
    let (energy, vertical) = invariants(&p);
    assert!((energy / energy_0 - 1.0).abs() < 1e-10, "{energy} {energy_0}");
    assert!((vertical / vertical_0 - 1.0).abs() < 1e-9);
}

/// Power: d(T + V)/dt is what motors and friction do on the wheels, u Om, integrated here by
/// Simpson's rule from the record.
#[test]
fn wheel_work_is_the_change_of_energy() {
    let mut model = free_platform();
    set_mass(&mut model, None, Vector3::new(0.3, -0.2, -2.0));
    for wheel in model.wheels_mut() {
        wheel.viscous_friction_n_m_s = 1e-3;
        wheel.coulomb_friction_n_m = 5e-3;
    }
    let mut p = plant(&model, &start(Vector3::new(0.3, -0.5, 0.8), &[100.0, -50.0, 30.0]));
    let torques = [0.2, -0.1, 0.3];
    p.command_wheels(&torques).unwrap();
    let energy = |p: &crate::Plant| {
        let s = p.state();
        p.gyrostat().kinetic_energy_j(&s.omega_wb_b_rad_s, s.wheel_speed_rad_s())
            + p.gyrostat().potential_energy_j(&s.q_world_body)
    };
    let power = |p: &crate::Plant| -> f64 {
        let speeds = p.state().wheel_speed_rad_s();
        (0..3).map(|j| (torques[j] - 1e-3 * speeds[j] - 5e-3 * speeds[j].signum()) * speeds[j]).sum()
    };
    let (energy_0, mut work) = (energy(&p), power(&p));
    let steps = 2000;
    for k in 1..=steps {
        p.advance_to(k * 1_000_000).unwrap();
        let weight = if k == steps {
            1.0
        } else if k % 2 == 1 {
            4.0
        } else {
            2.0
        };
        work += weight * power(&p);
    }
    work *= 1e-3 / 3.0;
    assert!(work.abs() > 1.0);
    assert!((energy(&p) - energy_0 - work).abs() < 1e-6 * work.abs(), "{} {work}", energy(&p) - energy_0);
}

/// Halving the step must shrink the error sixteenfold.
#[test]
fn integrator_is_of_fourth_order() {
    let mut model = free_platform();
    let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
    set_mass(&mut model, Some(inertia), Vector3::new(0.3, -0.2, -2.0));
    let initial = start(Vector3::new(0.6, -1.0, 1.6), &[100.0, -50.0, 30.0]);
    let end = |step_ns: i64| {
        let mut p = plant(&model, &initial).with_step_ns(step_ns);
        p.advance_to(ns(4.0)).unwrap();
        *p.state()
    };
    let reference = end(1_000_000);
    let error = |step_ns| {
        let state = end(step_ns);
        state.q_world_body.angle_to(&reference.q_world_body)
            + (state.omega_wb_b_rad_s - reference.omega_wb_b_rad_s).norm()
    };
    let errors = [error(80_000_000), error(40_000_000), error(20_000_000)];
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.7..4.6).contains(&order), "order {order}, errors {errors:?}");
    }
}
