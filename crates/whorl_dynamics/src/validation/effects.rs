//! Effects against closed forms and conservation laws.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, Matrix3, SymmetricEigen, UnitQuaternion, Vector2, Vector3};

use super::{free_platform, ns, plant, set_mass, start};
use crate::{Freedom, InitialState, Plant, PlatformModel};

pub(super) fn add(model: &mut PlatformModel, id: &str, values: &[(&str, f64)]) {
    let values: BTreeMap<String, f64> = values.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect();
    model.effects.insert(id.to_owned(), values);
}

/// Free platform with diagonal inertia (6, 7, 12) and no wheels.
fn simple(id: &str, values: &[(&str, f64)]) -> PlatformModel {
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0))), Vector3::zeros());
    add(&mut model, id, values);
    model
}

fn yaw_spin(rate_rad_s: f64) -> InitialState {
    InitialState { omega_wb_b_rad_s: Vector3::z() * rate_rad_s, ..InitialState::default() }
}

/// Yaw rate after `time_s` of a spin from `rate_rad_s`.
fn spin_after(model: &PlatformModel, rate_rad_s: f64, time_s: f64) -> f64 {
    let mut p = plant(model, &yaw_spin(rate_rad_s));
    p.advance_to(ns(time_s)).unwrap();
    p.state().omega_wb_b_rad_s.z
}

fn world_momentum(p: &Plant) -> Vector3<f64> {
    p.state().q_world_body * p.truth().momentum_b_n_m_s
}

fn kinetic_j(p: &Plant) -> f64 {
    p.gyrostat().kinetic_energy_j(&p.state().omega_wb_b_rad_s, p.state().wheel_speed_rad_s())
}

#[test]
fn spin_decays_as_each_friction_law_says() {
    let viscous = simple("bearing_viscous_friction", &[("c_n_m_s", 0.3)]);
    assert!((spin_after(&viscous, 0.8, 40.0) - 0.8 * (-1.0_f64).exp()).abs() < 1e-12);
    let quadratic = simple("air_drag_quadratic", &[("dz_n_m_s2", 0.6)]);
    assert!((spin_after(&quadratic, 0.8, 40.0) - 0.8 / (1.0 + 0.05 * 0.8 * 40.0)).abs() < 1e-12);
    let coulomb = simple("bearing_coulomb_friction", &[("torque_n_m", 0.12)]);
    assert!((spin_after(&coulomb, 0.8, 40.0) - 0.4).abs() < 1e-5, "a straight line");
    assert!(spin_after(&coulomb, 0.8, 82.0).abs() < 1e-9, "to a full stop");
}

/// A torque that is constant in the room makes the momentum in the room grow on a straight line,
/// however the body tumbles.
#[test]
fn air_current_is_constant_in_the_room() {
    let torque = Vector3::new(0.02, -0.03, 0.01);
    let values = [("t_x_n_m", torque.x), ("t_y_n_m", torque.y), ("t_z_n_m", torque.z)];
    let mut p = plant(&simple("air_current", &values), &start(Vector3::new(0.3, 0.5, -0.4), &[]));
    let before = world_momentum(&p);
    p.advance_to(ns(20.0)).unwrap();
    assert!((world_momentum(&p) - before - torque * 20.0).norm() < 1e-9);
}

#[test]
fn periodic_air_current_integrates_to_its_cosine() {
    let values = [("amplitude_y_n_m", 0.05), ("frequency_hz", 0.3), ("phase_rad", 0.4)];
    let mut p = plant(&simple("air_current_periodic", &values), &start(Vector3::new(0.3, 0.5, -0.4), &[]));
    let before = world_momentum(&p);
    p.advance_to(ns(7.7)).unwrap();
    let w = TAU * 0.3;
    let expected = 0.05 / w * (f64::cos(0.4) - f64::cos(0.4 + w * 7.7));
    assert!((world_momentum(&p) - before - Vector3::y() * expected).norm() < 1e-9);
}

#[test]
fn turbine_drives_the_vertical_or_body_axis() {
    let mut p = plant(
        &simple("bearing_turbine", &[("vertical_n_m", 0.02)]),
        &start(Vector3::new(0.3, 0.5, -0.4), &[]),
    );
    let before = world_momentum(&p);
    p.advance_to(ns(10.0)).unwrap();
    assert!((world_momentum(&p) - before - Vector3::z() * 0.2).norm() < 1e-10);
    let body = simple("bearing_turbine", &[("body_z_n_m", 0.03)]);
    assert!((spin_after(&body, 0.1, 10.0) - (0.1 + 0.3 / 12.0)).abs() < 1e-12);
}

/// Torques from a potential conserve kinetic plus potential energy.
#[test]
fn conservative_effects_conserve_energy() {
    let field = Vector3::new(-3.0e-6, 21.0e-6, -47.0e-6);
    let dipole = Vector3::new(400.0, -300.0, 500.0);
    let weight = 110.0 * 9.81;
    let compliance = Matrix3::new(2.0e-6, 1.0e-6, 0.0, 1.0e-6, -3.0e-6, 2.0e-6, 0.0, 2.0e-6, 4.0e-6);
    let inertia = Vector3::new(6.0, 7.0, 12.0);
    type Potential = Box<dyn Fn(&UnitQuaternion<f64>) -> f64>;
    let cases: [(PlatformModel, Potential); 4] = [
        (
            simple(
                "magnetic_torque",
                &[("dipole_x_a_m2", 400.0), ("dipole_y_a_m2", -300.0), ("dipole_z_a_m2", 500.0)],
            ),
            Box::new(move |q| -dipole.dot(&(q.inverse() * field))),
        ),
        (
            simple(
                "anisoelastic_sag",
                &[
                    ("cxx_m_n", 2.0e-6),
                    ("cxy_m_n", 1.0e-6),
                    ("cyy_m_n", -3.0e-6),
                    ("cyz_m_n", 2.0e-6),
                    ("czz_m_n", 4.0e-6),
                ],
            ),
            Box::new(move |q| {
                let k = q.inverse() * Vector3::z();
                -0.5 * weight * weight * k.dot(&(compliance * k))
            }),
        ),
        (
            simple("gravity_gradient", &[("scale", 1.0)]),
            Box::new(move |q| {
                let k = q.inverse() * Vector3::z();
                1.5 * 3.986_004e14 / 6.371e6_f64.powi(3) * inertia.component_mul(&k).dot(&k)
            }),
        ),
        (
            simple("gravity_offset", &[("mgr_x_n_m", 0.3), ("mgr_z_n_m", -1.0)]),
            Box::new(|q| Vector3::new(0.3, 0.0, -1.0).dot(&(q.inverse() * Vector3::z()))),
        ),
    ];
    for (model, potential) in cases {
        let mut p = plant(&model, &start(Vector3::new(0.05, 0.08, -0.04), &[]));
        let total = |p: &Plant| kinetic_j(p) + potential(&p.state().q_world_body);
        let (kinetic_0, total_0) = (kinetic_j(&p), total(&p));
        let mut exchanged: f64 = 0.0;
        for k in 1..=60 {
            p.advance_to(ns(0.5 * f64::from(k))).unwrap();
            exchanged = exchanged.max((kinetic_j(&p) - kinetic_0).abs());
            assert!((total(&p) - total_0).abs() < 1e-5 * exchanged + 1e-12, "{:?}", p.gyrostat().effects());
        }
        assert!(exchanged > 1e-8);
    }
}

#[test]
fn harness_swings_the_platform_at_its_natural_frequency() {
    let model = simple("harness_spring", &[("k_n_m_rad", 0.5), ("yaw0_rad", PI - 0.1)]);
    let mut p = plant(&model, &yaw_spin(0.0));
    // From yaw 0 the cable is twisted by -(pi - 0.1): a cosine about yaw0.
    let w = (0.5_f64 / 12.0).sqrt();
    for k in 1..20 {
        let t = f64::from(k);
        p.advance_to(ns(t)).unwrap();
        let yaw = whorl_math::azimuth_rad(&p.state().q_world_body);
        let expected = (PI - 0.1) * (1.0 - (w * t).cos());
        assert!(whorl_math::wrap_angle_rad(yaw - expected).abs() < 1e-9, "{t}: {yaw} {expected}");
    }
}

/// In axes that do not turn with the Earth no torque acts: momentum of everything that turns, the
/// Earth's rate included, is constant there.
#[test]
fn earth_rotation_conserves_inertial_momentum() {
    let mut model = free_platform();
    add(&mut model, "earth_rotation", &[("scale", 1.0)]);
    let latitude: f64 = 0.649_437;
    let earth = Vector3::new(0.0, latitude.cos(), latitude.sin()) * 7.292_115e-5;
    let momentum = |p: &Plant| {
        let s = p.state();
        let inertial_rate = s.omega_wb_b_rad_s + s.q_world_body.inverse() * earth;
        let body = p.gyrostat().momentum_b_n_m_s(&inertial_rate, s.wheel_speed_rad_s());
        UnitQuaternion::from_scaled_axis(earth * p.time_s()) * (s.q_world_body * body)
    };
    let mut p = plant(&model, &start(Vector3::new(0.3, 0.5, -0.4), &[100.0, 50.0, -70.0]));
    let (before, room_before) = (momentum(&p), world_momentum(&p));
    p.advance_to(ns(60.0)).unwrap();
    assert!((momentum(&p) - before).norm() < 1e-9 * before.norm());
    assert!((world_momentum(&p) - room_before).norm() > 1e-3 * before.norm(), "seen from the room it moves");
    // Free wheels keep their inertial momentum about their axis only if the body does not turn them:
    // a level body at rest in the room reads the Earth's rate.
    model.sensors.gyro.errors.noise_stddev = Vector3::zeros();
    model.sensors.gyro.errors.bias_turn_on_stddev = Vector3::zeros();
    let mut at_rest = plant(&model, &InitialState::default());
    assert!((at_rest.sample_imu().angular_velocity_rad_s - earth).norm() < 1e-15);
}

#[test]
fn jets_obey_strength_direction_delay_rise_and_leak() {
    let impulse = |id: &str, values: &[(&str, f64)]| {
        let mut p = plant(&simple(id, values), &InitialState::default());
        p.command_jet_pulse(0, ns(0.01), 0.1).unwrap();
        p.advance_to(ns(1.0)).unwrap();
        world_momentum(&p)
    };
    // Jet 1: 0.5 N along z at y = 0.45 m, 6 ms opening and 4 ms closing delay.
    let torque = 0.225;
    let strength = impulse("thruster_strength", &[("all", 0.1), ("jet_1", -0.2), ("jet_2", 0.5)]);
    assert!((strength.x - torque * 1.1 * 0.8 * 0.098).abs() < 1e-12);
    let delay = impulse("thruster_delay", &[("t_on_s", 0.02), ("t_off_s", 0.005)]);
    assert!((delay.x - torque * (0.098 - 0.015)).abs() < 1e-10);
    let rise = impulse("thruster_rise", &[("tau_s", 0.03)]);
    assert!((rise.x - torque * 0.098).abs() < 1e-9, "one lag does not change the impulse: {rise}");
    let tilted = impulse("thruster_misalignment", &[("jet_1_a_rad", 0.1)]);
    // The force turns by 0.1 rad; what is left along z is its cosine.
    assert!((tilted.x - torque * 0.098 * f64::cos(0.1)).abs() < 1e-5, "{tilted}");
    // Half way: t - tau (1 - exp(-t/tau)) after opening.
    let two = [("tau_s", 0.03), ("tail_ratio", 1.5)];
    let mut p = plant(&simple("thruster_rise", &two), &InitialState::default());
    p.command_jet_pulse(0, 0, 0.5).unwrap();
    p.advance_to(ns(0.056)).unwrap();
    let expected = torque * (0.05 - 0.03 * (1.0 - f64::exp(-0.05 / 0.03)));
    assert!((world_momentum(&p).x - expected).abs() < 1e-10);
    // Each edge starts from what the last has left: fractions and impulses over open and shut stretches, the
    // first-order law written out for each.
    let (rise_s, tail_s) = (0.03, 0.045);
    let mut p = plant(&simple("thruster_rise", &two), &InitialState::default());
    // Driven 0 .. 52 ms, 132 .. 154 ms: open 6 .. 56 ms, 138 .. 158 ms.
    p.command_jet_pulse(0, 0, 0.052).unwrap();
    p.command_jet_pulse(0, ns(0.132), 0.022).unwrap();
    p.advance_to(ns(0.208)).unwrap();
    let decay = |elapsed_s: f64, tau_s: f64| (-elapsed_s / tau_s).exp();
    let mut expected = 0.05 - rise_s * (1.0 - decay(0.05, rise_s));
    let at_first_close = 1.0 - decay(0.05, rise_s);
    expected += at_first_close * tail_s * (1.0 - decay(0.082, tail_s));
    let at_second_open = at_first_close * decay(0.082, tail_s);
    expected += 0.02 - (1.0 - at_second_open) * rise_s * (1.0 - decay(0.02, rise_s));
    let at_second_close = 1.0 - (1.0 - at_second_open) * decay(0.02, rise_s);
    expected += at_second_close * tail_s * (1.0 - decay(0.05, tail_s));
    assert!((world_momentum(&p).x / torque - expected).abs() < 1e-9, "{}", world_momentum(&p).x / torque);
    // A leak pushes for ever and uses gas.
    let mut p = plant(&simple("thruster_leak", &[("jet_1_n", 0.01)]), &InitialState::default());
    let gas_0 = p.truth().gas_kg;
    p.advance_to(ns(10.0)).unwrap();
    let used = 0.01 * 10.0 / (9.81 * 60.0);
    assert!(((gas_0 - p.truth().gas_kg) / used - 1.0).abs() < 1e-3);
    assert!((p.truth().momentum_b_n_m_s.norm() / (0.01 * 0.45 * 10.0) - 1.0).abs() < 1e-3);
}

/// dm/dt = -k m^n has m^(1-n) falling on a straight line.
#[test]
fn thrust_follows_pressure_by_its_exponent() {
    let mut model = simple("thruster_pressure", &[("exponent", 0.5)]);
    model.tank_mut().volume_m3 = 2e-4;
    let mut p = plant(&model, &InitialState::default());
    let gas_0 = p.truth().gas_kg;
    p.command_jet_pulse(0, 0, 60.0).unwrap();
    p.advance_to(ns(40.006)).unwrap();
    let rate = 0.5 / (9.81 * 60.0);
    let expected = gas_0 * (1.0 - 0.5 * rate * 40.0 / gas_0).powi(2);
    assert!(expected < 0.95 * gas_0);
    assert!((p.truth().gas_kg / expected - 1.0).abs() < 1e-10);
}

#[test]
fn used_gas_and_reversed_ballast_shift_the_balance() {
    let mut p = plant(&simple("mass_shift", &[("shift_x_n_m_kg", 10.0)]), &InitialState::default());
    for jet in [0, 2] {
        p.command_jet_pulse(jet, 0, 50.0).unwrap();
    }
    p.advance_to(ns(10.0)).unwrap();
    let q = p.state().q_world_body;
    let used = 2.0 * 0.5 * (10.0 - 0.006) / (9.81 * 60.0);
    // -(s used, 0, 0) x k_b, about y: + s used k_z.
    let expected = 10.0 * used * (q.inverse() * Vector3::z()).z / 7.0;
    assert!((p.angular_acceleration_b_rad_s2().y - expected).abs() < 1e-3 * expected, "{expected}");
    let mut p = plant(&simple("moving_ballast_backlash", &[("gap_x_n_m", 0.1)]), &InitialState::default());
    let mut coming_from = |from: f64| {
        p.set_ballast_moment(Vector3::x() * from);
        p.set_ballast_moment(Vector3::zeros());
        p.angular_acceleration_b_rad_s2().y * 7.0
    };
    // Arriving from above (last travel downwards) the mass stays 0.05 N m too far up.
    assert!((coming_from(1.0) - 0.05).abs() < 1e-12);
    assert!((coming_from(-1.0) + 0.05).abs() < 1e-12);
}

#[test]
fn wheels_obey_friction_windage_voltage_and_imbalance() {
    let wheel = |id: &str, values: &[(&str, f64)]| {
        let mut model = free_platform();
        add(&mut model, id, values);
        let initial = InitialState { wheel_speed_rad_s: vec![100.0, 0.0, 0.0], ..InitialState::default() };
        let mut p = plant(&model, &initial);
        p.set_clamped(true);
        p
    };
    let mut p = wheel("wheel_windage", &[("wheel_x_n_m_s2", 1e-5)]);
    p.advance_to(ns(20.0)).unwrap();
    let expected = 100.0 / (1.0 + 1e-5 / 0.08 * 100.0 * 20.0);
    assert!((p.state().wheel_speed_rad_s()[0] - expected).abs() < 1e-9);
    let mut p = wheel("wheel_friction", &[("wheel_x_viscous_n_m_s", 4e-4)]);
    p.advance_to(ns(20.0)).unwrap();
    assert!((p.state().wheel_speed_rad_s()[0] - 100.0 * f64::exp(-0.1)).abs() < 1e-9);
    let mut p = wheel("supply_voltage", &[("wheel_torque_per_v", 0.05)]);
    p.command_wheels(&[0.0, 0.4, 0.0]).unwrap();
    p.advance_to(ns(1.0)).unwrap();
    // Sag 0.5 V/(N m) at 0.4 N m, discharge 2e-4 V/s: mean drop 0.2001 V over the second.
    let expected = 0.4 * (1.0 - 0.05 * 0.2001) / 0.08;
    assert!((p.state().wheel_speed_rad_s()[1] - expected).abs() < 1e-9);
    let mut p = wheel("wheel_imbalance", &[("wheel_x_kg_m2", 1e-5)]);
    p.advance_to(ns(0.3)).unwrap();
    let torque = p.gyrostat().effects().torque_b_n_m(&p.environment(), &p.state().hidden);
    assert!((torque.norm() - 1e-5 * 1e4).abs() < 1e-12 && torque.x == 0.0);
    assert!((p.state().hidden[0] - 30.0).abs() < 1e-9, "the wheel's angle");
}

#[test]
fn gyro_effects_reach_the_reading() {
    let reading = |id: &str, values: &[(&str, f64)], time_s: f64| {
        let mut model = simple(id, values);
        model.sensors.gyro.errors.noise_stddev = Vector3::zeros();
        model.sensors.gyro.errors.bias_turn_on_stddev = Vector3::zeros();
        model.sensors.gyro.errors.bias_walk = Vector3::zeros();
        let mut p = plant(&model, &yaw_spin(0.5));
        p.advance_to(ns(time_s)).unwrap();
        p.sample_imu().angular_velocity_rad_s
    };
    let near = |y: Vector3<f64>, x: [f64; 3]| assert!((y - Vector3::from(x)).norm() < 1e-12, "{y}");
    near(reading("gyro_bias", &[("bias_x_rad_s", 0.01)], 1.0), [0.01, 0.0, 0.5]);
    near(reading("gyro_scale", &[("scale_z", 0.1)], 1.0), [0.0, 0.0, 0.55]);
    near(reading("gyro_misalignment", &[("yz_rad", 0.02)], 1.0), [0.0, 0.01, 0.5]);
    // The platform warms by 2 mK/s.
    near(reading("gyro_temperature", &[("slope_y_rad_s_k", 0.005)], 100.0), [0.0, 0.005 * 0.2, 0.5]);
    near(reading("gyro_saturation", &[("range_rad_s", 0.3)], 1.0), [0.0, 0.0, 0.3]);
    let values = [("gyro_x_rad_s", 0.1), ("frequency_hz", 101.0), ("background", 1.0)];
    // 101 Hz sampled at 100 Hz looks like 1 Hz: the same reading at whole samples.
    near(reading("vibration_alias", &values, 0.12), [0.1 * (TAU * 0.12).sin(), 0.0, 0.5]);
    // Specific force at rest rotation about z with the lever arm: g on z, -w^2 r across.
    let y = reading("gyro_g_sensitivity", &[("xz_s_m", 1e-3)], 1.0);
    near(y, [9.81e-3, 0.0, 0.5]);
}

/// A body with one elastic mode, free about x: the free-free frequency is W / sqrt(1 - d^2/I).
#[test]
fn flexible_mode_vibrates_at_the_free_free_frequency() {
    let (d, f): (f64, f64) = (1.2, 2.0);
    let model = simple(
        "flexible_mode",
        &[("participation_x_sqrt_kg_m", d), ("frequency_hz", f), ("damping_ratio", 0.0)],
    );
    let mut p = plant(&model, &InitialState::default());
    p.command_jet_pulse(0, 0, 0.02).unwrap();
    p.advance_to(ns(0.1)).unwrap();
    let expected_hz = f / (1.0 - d * d / 6.0).sqrt();
    let (mut before, mut crossings) = (p.state().hidden[0], Vec::new());
    while crossings.len() < 21 {
        let now_ns = p.now_ns() + 1_000_000;
        p.advance_to(now_ns).unwrap();
        let now = p.state().hidden[0];
        if before * now < 0.0 {
            crossings.push(now_ns as f64 * 1e-9 - 1e-3 * now / (now - before));
        }
        before = now;
    }
    let found_hz = 10.0 / (crossings[20] - crossings[0]);
    assert!((found_hz / expected_hz - 1.0).abs() < 1e-5, "{found_hz} {expected_hz}");
    // Momentum of body and appendage is what the jet gave: I w + d eta'.
    let total = 6.0 * p.state().omega_wb_b_rad_s.x + d * p.state().hidden[1];
    assert!((total - 0.225 * 0.018).abs() < 1e-9, "{total}");
}

/// Small motion of platform and pendulum mass from Lagrange's equations, by modal superposition.
/// With the body's angle th about y and xi = sqrt(m) times the mass's deflection s:
/// M = [I, sqrt(m) h; sqrt(m) h, 1], K = [-mgr_z, -sqrt(m) g; -sqrt(m) g, W^2].
#[test]
fn slosh_swings_as_lagrange_says() {
    let (ratio, f, h, mgr): (f64, f64, f64, f64) = (0.02, 0.9, 0.3, 30.0);
    let mut model = simple(
        "slosh",
        &[("mass_ratio", ratio), ("frequency_hz", f), ("height_m", h), ("damping_ratio", 0.0)],
    );
    set_mass(&mut model, None, Vector3::z() * -mgr);
    let angle_0 = 1e-5;
    let initial = InitialState {
        q_world_body: UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_0),
        ..InitialState::default()
    };
    let mut p = plant(&model, &initial);
    let root_mass = (ratio * 110.0).sqrt();
    let (inertia, w) = (7.0, TAU * f);
    let mass = Matrix2::new(inertia, root_mass * h, root_mass * h, 1.0);
    let stiffness = Matrix2::new(mgr, -root_mass * 9.81, -root_mass * 9.81, w * w);
    // M^-1/2 K M^-1/2 in modal coordinates, started at rest with (angle_0, 0).
    let eigen = SymmetricEigen::new(mass);
    let power = |e: f64| {
        eigen.eigenvectors
            * Matrix2::from_diagonal(&eigen.eigenvalues.map(|x| x.powf(e)))
            * eigen.eigenvectors.transpose()
    };
    let modes = SymmetricEigen::new(power(-0.5) * stiffness * power(-0.5));
    assert!(modes.eigenvalues.iter().all(|x| *x > 0.0), "the equilibrium must be stable");
    let start_modal = modes.eigenvectors.transpose() * power(0.5) * Vector2::new(angle_0, 0.0);
    for k in 1..=50 {
        let t = 0.2 * f64::from(k);
        p.advance_to(ns(t)).unwrap();
        let modal = Vector2::from_fn(|i, _| start_modal[i] * (modes.eigenvalues[i].sqrt() * t).cos());
        let expected = power(-0.5) * modes.eigenvectors * modal;
        let angle = 2.0 * p.state().q_world_body.j;
        assert!((angle - expected.x).abs() < 1e-7 * angle_0, "{t}: {angle} {expected}");
        assert!((root_mass * p.state().hidden[0] - expected.y).abs() < 1e-6 * angle_0);
    }
}

/// A spacecraft pushed along x by a jet above its centre of mass. Lagrange's equations for the centre of mass at rest x, the
/// angle th about y and a particle's deflection s on a spring of frequency W0: M x'' + m s'' = F, I th'' + m h s'' = F z,
/// m x'' + m h th'' + m s'' + m W0^2 s = 0. Without x and th: a s'' + W0^2 s = -b, a = 1 - m/M - m h^2/I, b = F/M + h F z/I.
#[test]
fn slosh_in_free_fall_feels_the_thrust() {
    let (mass, loose, w0, h): (f64, f64, f64, f64) = (110.0, 4.0, 3.0, 0.4);
    let (force, arm, inertia) = (0.3, 0.5, 7.0);
    let left = 1.0 - loose / mass;
    let values = [
        ("mass_ratio", loose / mass / left),
        ("frequency_hz", w0 / left.sqrt() / TAU),
        ("height_m", h),
        ("damping_ratio", 0.0),
    ];
    let mut model = simple("slosh", &values);
    model.freedom = Freedom::Free;
    let mut jet = model.jets()[0].clone();
    jet.position_b_m = Vector3::z() * arm;
    jet.force_direction_b = Vector3::x_axis();
    jet.thrust_n = force;
    (jet.opening_delay_s, jet.closing_delay_s) = (0.0, 0.0);
    *model.jets_mut() = vec![jet];
    model.tank_mut().thrust_pressure_exponent = 0.0;
    let mut p = plant(&model, &InitialState::default());
    p.command_jet_pulse(0, 0, 3.0).unwrap();
    let a = left - loose * h * h / inertia;
    let b = force / mass + h * force * arm / inertia;
    let w = (w0 * w0 / a).sqrt();
    for k in 1..=20 {
        let t = 0.1 * f64::from(k);
        p.advance_to(ns(t)).unwrap();
        let s = -b / (w0 * w0) * (1.0 - (w * t).cos());
        let s_rate = -b / (w0 * w0) * w * (w * t).sin();
        let rate = (force * arm * t - loose * h * s_rate) / inertia;
        // Small angles, small deflections: what is left is of second order.
        assert!(
            (p.state().omega_wb_b_rad_s.y - rate).abs() < 2e-5 * rate.abs(),
            "{t}: {:?} {rate}",
            p.state()
        );
        assert!((p.state().hidden[0] - left * s).abs() < 2e-4 * b / (w0 * w0), "{t}");
    }
}

#[test]
fn unmodelled_torque_walks_with_its_intensity() {
    let model = simple("unmodelled_torque", &[("intensity_y_n_m_sqrt_s", 1e-3)]);
    let squares: f64 = (0..400)
        .map(|seed| {
            let mut p = Plant::new(&model, &InitialState::default(), seed).unwrap();
            p.advance_to(ns(0.25)).unwrap();
            let [x, y, z, ..] = p.state().hidden;
            assert_eq!((x, z), (0.0, 0.0));
            y * y
        })
        .sum();
    let stddev = (squares / 400.0_f64).sqrt();
    // 400 runs know sigma to 3.5 %.
    assert!((stddev / (1e-3 * 0.5) - 1.0).abs() < 0.14, "{stddev}");
}
