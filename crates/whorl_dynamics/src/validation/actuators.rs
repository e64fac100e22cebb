//! Jets, tank and wheels.

use nalgebra::{Matrix3, Vector3};

use super::{free_platform, ns, plant, set_mass};
use crate::{CommandError, InitialState, JetFailure, Plant, PlatformModel};

/// Free platform on diagonal inertia, so that a jet about x turns it about x alone.
fn jet_platform() -> PlatformModel {
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(6.0, 7.0, 12.0))), Vector3::zeros());
    model
}

/// Angular impulse about x so far [N m s].
fn impulse_n_m_s(p: &Plant) -> f64 {
    p.truth().momentum_b_n_m_s.x
}

#[test]
fn pulse_impulse_is_exact_whatever_the_phase_of_the_step() {
    let model = jet_platform();
    let torque = model.jets()[0].torque_b_n_m().x;
    // Opening delay 6 ms, closing delay 4 ms: a pulse of T delivers T - 2 ms.
    for (start_ns, on_time_s) in
        [(0, 0.02), (123_457, 0.012_345_678), (999_999, 0.010), (500_000, 0.1), (17, 0.033_333_333)]
    {
        for step_ns in [1_000_000, 700_001, 5_000_000] {
            let mut p = plant(&model, &InitialState::default()).with_step_ns(step_ns);
            let pulse = p.command_jet_pulse(0, start_ns, on_time_s).unwrap();
            assert_eq!(pulse.opens_ns - start_ns, 6_000_000);
            p.advance_to(ns(0.3)).unwrap();
            let expected = torque * (on_time_s - 0.002);
            // Half a nanosecond of rounding on the on-time, no more.
            assert!((impulse_n_m_s(&p) - expected).abs() < torque * 1e-9, "{start_ns} {on_time_s} {step_ns}");
            assert!((p.valve_driven_s(0) - on_time_s).abs() < 1e-9);
            assert!((p.truth().valve_open_s[0] - (on_time_s - 0.002)).abs() < 1e-9);
        }
    }
}

#[test]
fn gas_flows_only_between_the_delayed_edges() {
    let mut p = plant(&jet_platform(), &InitialState::default());
    p.command_jet_pulse(0, ns(0.0105), 0.02).unwrap();
    p.advance_to(ns(0.0165)).unwrap();
    assert_eq!(impulse_n_m_s(&p), 0.0, "the valve opens at 16.5 ms");
    p.advance_to(ns(0.0175)).unwrap();
    let torque = p.gyrostat().model().jets()[0].torque_b_n_m().x;
    assert!((impulse_n_m_s(&p) - torque * 1e-3).abs() < 1e-15);
    p.advance_to(ns(0.0345)).unwrap();
    let at_close = impulse_n_m_s(&p);
    p.advance_to(ns(0.1)).unwrap();
    assert_eq!(impulse_n_m_s(&p), at_close, "the valve closed at 34.5 ms");
}

#[test]
fn pulses_in_adjoining_slots_are_one_long_pulse() {
    let model = jet_platform();
    let torque = model.jets()[0].torque_b_n_m().x;
    let mut p = plant(&model, &InitialState::default());
    // Slot by slot, as a driver does: the next pulse is commanded when the last one ends.
    for slot in 0..10 {
        p.advance_to(slot * 20_000_000).unwrap();
        p.command_jet_pulse(0, slot * 20_000_000, 0.02).unwrap();
    }
    p.advance_to(ns(1.0)).unwrap();
    assert!((impulse_n_m_s(&p) - torque * (0.2 - 0.002)).abs() < torque * 1e-9);
    assert!((p.valve_driven_s(0) - 0.2).abs() < 1e-12);
    // With no delays at all the same must hold.
    let mut model = jet_platform();
    model.jets_mut()[0].opening_delay_s = 0.0;
    model.jets_mut()[0].closing_delay_s = 0.0;
    let mut p = plant(&model, &InitialState::default());
    for slot in 0..10 {
        p.advance_to(slot * 20_000_000).unwrap();
        p.command_jet_pulse(0, slot * 20_000_000, 0.02).unwrap();
    }
    p.advance_to(ns(1.0)).unwrap();
    assert!((impulse_n_m_s(&p) - torque * 0.2).abs() < torque * 1e-9);
}

#[test]
fn commands_that_make_no_sense_are_refused() {
    let mut p = plant(&jet_platform(), &InitialState::default());
    p.advance_to(ns(0.05)).unwrap();
    assert_eq!(p.command_jet_pulse(12, ns(0.1), 0.02), Err(CommandError::UnknownJet { jet: 12, jets: 12 }));
    assert_eq!(p.command_jet_pulse(0, ns(0.1), f64::NAN), Err(CommandError::NotFinite));
    assert!(matches!(p.command_jet_pulse(0, ns(0.01), 0.02), Err(CommandError::InThePast { .. })));
    for too_short in [0.009, 0.0, -1.0] {
        let refused = p.command_jet_pulse(0, ns(0.1), too_short);
        assert!(matches!(refused, Err(CommandError::BelowMinimumOnTime { .. })), "{too_short}");
    }
    assert!(p.command_jet_pulse(0, ns(0.1), 0.010).is_ok(), "the shortest pulse itself");
    assert!(matches!(p.command_wheels(&[1.0]), Err(CommandError::MotorCount { .. })));
    assert!(p.advance_to(0).is_err(), "time does not run backwards");
    let mut p = plant(&free_platform(), &InitialState::default());
    assert_eq!(p.command_wheels(&[0.0, f64::NAN, 0.0]), Err(CommandError::NotFinite));
}

#[test]
fn closing_all_valves_cuts_pulses_short_and_forgets_later_ones() {
    let model = jet_platform();
    let torque = model.jets()[0].torque_b_n_m().x;
    let mut p = plant(&model, &InitialState::default());
    p.command_jet_pulse(0, 0, 0.5).unwrap();
    p.command_jet_pulse(0, ns(0.7), 0.1).unwrap();
    p.advance_to(ns(0.1)).unwrap();
    p.close_all_valves(ns(0.1));
    p.advance_to(ns(1.0)).unwrap();
    assert!((impulse_n_m_s(&p) - torque * (0.1 - 0.002)).abs() < torque * 1e-9);
    assert!((p.valve_driven_s(0) - 0.1).abs() < 1e-9);
}

#[test]
fn broken_valves_do_not_obey_and_the_driver_does_not_know() {
    let model = jet_platform();
    let torque = model.jets()[0].torque_b_n_m().x;
    let mut p = plant(&model, &InitialState::default());
    p.set_jet_failure(0, JetFailure::StuckClosed).unwrap();
    p.command_jet_pulse(0, 0, 0.1).unwrap();
    p.advance_to(ns(0.2)).unwrap();
    assert_eq!(impulse_n_m_s(&p), 0.0);
    assert!((p.valve_driven_s(0) - 0.1).abs() < 1e-9);
    assert_eq!(p.truth().valve_open_s[0], 0.0);
    p.set_jet_failure(0, JetFailure::StuckOpen).unwrap();
    p.advance_to(ns(0.3)).unwrap();
    p.set_jet_failure(0, JetFailure::None).unwrap();
    p.advance_to(ns(1.0)).unwrap();
    assert!((impulse_n_m_s(&p) - torque * 0.1).abs() < 1e-12);
    assert!(p.set_jet_failure(99, JetFailure::None).is_err());
}

/// Thrust proportional to pressure, isothermal: m(t) = m0 exp(-t/T), T = m0 g0 Isp / F0.
#[test]
fn tank_blows_down_as_in_closed_form() {
    let mut model = jet_platform();
    model.tank_mut().thrust_pressure_exponent = 1.0;
    model.tank_mut().volume_m3 = 2e-4;
    let mut p = plant(&model, &InitialState::default());
    let gas_0 = p.truth().gas_kg;
    let expected_0 = 2.0e7 * 2e-4 / (296.8 * 293.15);
    assert!((gas_0 / expected_0 - 1.0).abs() < 1e-14);
    for jet in [0, 2] {
        p.command_jet_pulse(jet, 0, 60.0).unwrap();
    }
    let time_constant_s = gas_0 * 9.81 * 60.0 / (2.0 * 0.5);
    p.advance_to(ns(30.006)).unwrap();
    let expected = gas_0 * (-30.0 / time_constant_s).exp();
    assert!(expected / gas_0 < 0.6, "it must lose much for the test to mean anything");
    assert!((p.truth().gas_kg / expected - 1.0).abs() < 1e-11, "{} {expected}", p.truth().gas_kg);
    // A pair of opposite jets turns nothing; the used gas is what the specific impulse says.
    assert!(impulse_n_m_s(&p).abs() < 1e-12);
}

#[test]
fn wheel_coasts_down_by_viscous_and_coulomb_friction_and_stays() {
    // Body clamped: J dOm/dt = -b Om - T: Om(t) = (Om0 + T/b) exp(-b t/J) - T/b, stop at
    // (J/b) ln(1 + b Om0/T).
    let mut model = free_platform();
    let (b, t, inertia) = (2e-3, 0.02, model.wheels()[0].spin_inertia_kg_m2);
    for wheel in model.wheels_mut() {
        (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (b, t);
    }
    let initial = InitialState { wheel_speed_rad_s: vec![30.0, -30.0, 0.0], ..InitialState::default() };
    let mut p = plant(&model, &initial);
    p.set_clamped(true);
    let stop_s = inertia / b * (b * 30.0 / t).ln_1p();
    for share in [0.25, 0.5, 0.99] {
        let time_s = share * stop_s;
        p.advance_to(ns(time_s)).unwrap();
        let expected = (30.0 + t / b) * (-b * time_s / inertia).exp() - t / b;
        assert!((p.state().wheel_speed_rad_s()[0] - expected).abs() < 1e-8);
        assert!((p.state().wheel_speed_rad_s()[1] + expected).abs() < 1e-8);
    }
    p.advance_to(ns(stop_s + 0.001)).unwrap();
    for _ in 0..100 {
        assert_eq!(p.state().wheel_speed_rad_s()[..3], [0.0; 3], "stopped for good");
        p.advance_to(p.now_ns() + 1_300_000).unwrap();
    }
    // Below the Coulomb torque nothing moves; above it only the excess accelerates.
    p.command_wheels(&[0.9 * t, 0.0, 0.0]).unwrap();
    p.advance_to(p.now_ns() + ns(0.1)).unwrap();
    assert_eq!(p.state().wheel_speed_rad_s()[0], 0.0);
    p.command_wheels(&[-1.5 * t, 0.0, 0.0]).unwrap();
    p.advance_to(p.now_ns() + ns(0.1)).unwrap();
    let expected = -0.5 * t / b * (1.0 - (-b * 0.1 / inertia).exp());
    assert!((p.state().wheel_speed_rad_s()[0] - expected).abs() < 1e-10);
}

#[test]
fn friction_between_wheel_and_body_keeps_the_total_momentum() {
    let mut model = free_platform();
    for wheel in model.wheels_mut() {
        (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (2e-3, 0.05);
    }
    let mut p =
        plant(&model, &InitialState { wheel_speed_rad_s: vec![20.0, -11.0, 7.0], ..InitialState::default() });
    let world = |p: &Plant| p.state().q_world_body * p.truth().momentum_b_n_m_s;
    let before = world(&p);
    p.advance_to(ns(60.0)).unwrap();
    assert_eq!(p.state().wheel_speed_rad_s()[..3], [0.0; 3], "all wheels have stopped");
    assert!((world(&p) - before).norm() < 1e-8, "{}", world(&p) - before);
}

#[test]
fn motors_respect_their_torque_and_speed_limits() {
    let model = free_platform();
    let mut p = plant(&model, &InitialState::default());
    p.set_clamped(true);
    p.command_wheels(&[10.0, -10.0, 0.1]).unwrap();
    let used: Vec<f64> = p.sample_wheels().iter().map(|w| w.motor_torque_n_m).collect();
    assert_eq!(used, [0.5, -0.5, 0.1]);
    p.advance_to(ns(120.0)).unwrap();
    let [x, y, _, ..] = *p.state().wheel_speed_rad_s();
    assert!((197.9..=200.0).contains(&x) && (-200.0..=-197.9).contains(&y), "{x} {y}");
}

#[test]
fn the_stop_holds_a_platform_that_leans_on_it() {
    let model = PlatformModel::whorl_1_reference();
    let initial = InitialState { omega_wb_b_rad_s: Vector3::new(0.3, 0.2, 0.0), ..InitialState::default() };
    let mut p = plant(&model, &initial);
    let mut largest: f64 = 0.0;
    for k in 1..10_000 {
        p.advance_to(k * 1_000_000).unwrap();
        largest = largest.max(whorl_math::tilt_rad(&p.state().q_world_body).to_degrees());
    }
    assert!((5.0..6.5).contains(&largest), "{largest} deg");
}
