//! Drives, cables, drag by a power and sensors with a low-pass against closed forms.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::{free_platform, ns, plant, set_mass};
use crate::{InitialState, Plant, PlatformModel};

const INERTIA_Z: f64 = 12.0;

fn with(mut model: PlatformModel, id: &str, values: &[(&str, f64)]) -> PlatformModel {
    let values: BTreeMap<String, f64> = values.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect();
    model.effects.insert(id.to_owned(), values);
    model
}

/// Free platform with diagonal inertia and no wheels, quiet sensors.
fn bare() -> PlatformModel {
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, INERTIA_Z))), Vector3::zeros());
    for errors in [&mut model.sensors.gyro.errors, &mut model.sensors.accelerometer.errors] {
        errors.noise_stddev = Vector3::zeros();
        errors.bias_turn_on_stddev = Vector3::zeros();
        errors.bias_walk = Vector3::zeros();
    }
    model
}

fn spinning(model: &PlatformModel, rate_rad_s: f64) -> Plant {
    plant(model, &InitialState { omega_wb_b_rad_s: Vector3::z() * rate_rad_s, ..InitialState::default() })
}

fn yaw_rate(p: &Plant) -> f64 {
    p.state().omega_wb_b_rad_s.z
}

/// I dw/dt = -d (w/0.1)^p: w^(1-p) grows on a straight line.
#[test]
fn drag_by_a_power_decays_as_its_exponent_says() {
    for exponent in [1.25_f64, 1.5, 2.0, 2.5] {
        let model = with(bare(), "air_drag_power", &[("d_n_m", 0.004), ("exponent", exponent)]);
        let mut p = spinning(&model, 0.8);
        p.advance_to(ns(60.0)).unwrap();
        let slope = (exponent - 1.0) * 0.004 / INERTIA_Z * 10.0_f64.powf(exponent);
        let expected = (0.8_f64.powf(1.0 - exponent) + slope * 60.0).powf(1.0 / (1.0 - exponent));
        assert!((yaw_rate(&p) - expected).abs() < 1e-10, "{exponent}: {} {expected}", yaw_rate(&p));
    }
}

/// The integral of s sin(wt) + c cos(wt).
#[test]
fn a_machine_on_the_platform_pushes_with_its_sine_and_cosine() {
    let values = [("sine_z_n_m", 0.02), ("cosine_z_n_m", -0.05), ("frequency_hz", 0.3)];
    let mut p = spinning(&with(bare(), "periodic_torque", &values), 0.4);
    p.advance_to(ns(7.7)).unwrap();
    let w = TAU * 0.3;
    let (sine, cosine) = (w * 7.7).sin_cos();
    let expected = 0.4 + (0.02 * (1.0 - cosine) - 0.05 * sine) / (w * INERTIA_Z);
    assert!((yaw_rate(&p) - expected).abs() < 1e-11);
}

/// A spring that counts turns is harmonic however far it is wound.
#[test]
fn a_cable_swings_over_several_turns_as_one_spring() {
    let (k, turns) = (0.03, 2.3);
    let model = with(bare(), "winding_cable", &[("k_n_m_rad", k), ("yaw0_rad", 0.0)]);
    let w = (k / INERTIA_Z).sqrt();
    let amplitude_rad = turns * TAU;
    let mut p = spinning(&model, amplitude_rad * w);
    for share in [0.1, 0.25, 0.6, 1.0] {
        let time_s = share * TAU / w;
        p.advance_to(ns(time_s)).unwrap();
        let (sine, cosine) = (w * time_s).sin_cos();
        assert!((p.state().hidden[0] - amplitude_rad * sine).abs() < 1e-6, "{}", p.state().hidden[0]);
        assert!((yaw_rate(&p) - amplitude_rad * w * cosine).abs() < 1e-7);
    }
    // From its relaxed heading half a turn away, both cables pull alike; a turn further on only this one remembers.
    let near = [("k_n_m_rad", k), ("yaw0_rad", 1.0)];
    for (id, turns) in [("winding_cable", 0.0), ("winding_cable", 1.0), ("harness_spring", 1.0)] {
        let p = spinning(&with(bare(), id, &near), 0.0);
        let hidden = [turns * TAU];
        let torque = p.gyrostat().effects().torque_b_n_m(&p.environment(), &hidden);
        let counted = if id == "winding_cable" { turns * TAU } else { 0.0 };
        assert!((torque.z + k * (counted - 1.0)).abs() < 1e-12, "{id} {turns}: {torque}");
    }
}

/// Momentum of the wheel about its axis: bias and constant go to wheel and body alike, an inertia does not.
#[test]
fn motors_give_what_their_bias_and_constant_say() {
    let wheel = |id: &str, values: &[(&str, f64)]| {
        let mut p = plant(&with(free_platform(), id, values), &InitialState::default());
        p.command_wheels(&[0.0, 0.0, 0.2]).unwrap();
        p.advance_to(ns(2.0)).unwrap();
        let (speed, rate) = (p.state().wheel_speed_rad_s()[2], p.state().omega_wb_b_rad_s);
        assert!(p.truth().momentum_b_n_m_s.norm() < 1e-12, "the body takes the opposite");
        0.08 * (speed + rate.z)
    };
    assert!((wheel("wheel_motor_bias", &[("wheel_z_n_m", -0.05)]) - 0.15 * 2.0).abs() < 1e-9);
    assert!((wheel("wheel_motor_constant", &[("wheel_z", 0.1)]) - 0.22 * 2.0).abs() < 1e-9);
    assert!((wheel("wheel_motor_constant", &[("wheel_x", 0.1)]) - 0.2 * 2.0).abs() < 1e-9);
}

#[test]
fn thrust_and_gas_follow_the_voltage() {
    let pulse = |initial_v: f64, effect: bool| {
        let mut model = bare();
        (model.bus.initial_v, model.bus.full_v, model.bus.discharge_v_s) = (initial_v, 25.0, 0.0);
        if effect {
            model = with(model, "thruster_voltage", &[("thrust_per_v", 0.04)]);
        }
        let mut p = plant(&model, &InitialState::default());
        let full_kg = p.state().gas_kg();
        p.command_jet_pulse(0, ns(0.01), 0.1).unwrap();
        p.advance_to(ns(1.0)).unwrap();
        (p.truth().momentum_b_n_m_s.norm(), full_kg - p.state().gas_kg())
    };
    let (impulse, gas_kg) = pulse(22.0, false);
    assert_eq!(pulse(25.0, true), pulse(25.0, false));
    let (low_impulse, low_gas_kg) = pulse(22.0, true);
    assert!((low_impulse / impulse - (1.0 - 0.04 * 3.0)).abs() < 1e-12);
    assert!((low_gas_kg / gas_kg - 0.88).abs() < 1e-9);
    assert_eq!(pulse(-5.0, true).0, 0.0);
}

/// A step of torque from rest: the rate is a ramp, and so is the tangential acceleration a step.
#[test]
fn a_low_pass_rounds_off_what_is_quick() {
    let (tau_s, latency_s, torque) = (0.03, 0.004, 0.225);
    let mut model = bare();
    model.sensors.accelerometer.errors.time_constant_s = 0.01;
    model.sensors.gyro.errors.latency_s = latency_s;
    // Half stated by the sensor, half by the effect.
    model.sensors.gyro.errors.time_constant_s = 0.5 * tau_s;
    let model = with(model, "imu_bandwidth", &[("gyro_s", 0.5 * tau_s), ("accel_s", 0.01)]);
    let arm = model.sensors.accelerometer.lever_arm_b_m;
    let mut p = plant(&model, &InitialState::default());
    // Jet 1 about x, open 6 ms after the command.
    p.command_jet_pulse(0, ns(0.094), 0.5).unwrap();
    p.advance_to(ns(0.1)).unwrap();
    assert!(p.sample_imu().angular_velocity_rad_s.norm() < 1e-12);
    let alpha = torque / 6.0;
    let spacing_s = 0.007;
    for k in 1..20 {
        let t = spacing_s * f64::from(k);
        p.advance_to(ns(0.1 + t)).unwrap();
        let sample = p.sample_imu();
        let seen_s = (t - latency_s).max(0.0);
        let rate = alpha * (seen_s - tau_s + tau_s * (-seen_s / tau_s).exp());
        assert!((sample.angular_velocity_rad_s.x - rate).abs() < 1e-8, "{t}");
        // dw/dt x r, about x: z answers with alpha times y.
        let tangential = alpha * arm.y * (1.0 - (-t / 0.02).exp());
        assert!((sample.specific_force_m_s2.z - 9.81 - tangential).abs() < 1e-4, "{t}");
    }
}
