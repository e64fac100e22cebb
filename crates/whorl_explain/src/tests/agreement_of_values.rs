//! One parameter has one value and one deviation, whichever command is asked: dry friction of a wheel on a clamped bench, driven up and
//! turned round, integrated here by its own equations.

use nalgebra::{Unit, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::Wheel;
use whorl_dynamics::{Freedom, ModelPrior, PlatformModel};
use whorl_identification::{Fit, Options, fit};
use whorl_recording::{Mounting, Recording};

use crate::{Case, adopt, diagnose};

const EFFECT: &str = "wheel_friction";
const SPIN_INERTIA_KG_M2: f64 = 9.46e-4;
/// Dry friction [N m].
const FRICTION_N_M: f64 = 2.4e-3;
/// Time constant of the motor's current \[s\].
const CURRENT_S: f64 = 0.4;
const STEP_S: f64 = 0.005;
/// Noise of a reading of the speed [rad/s].
const TACHOMETER_RAD_S: f64 = 0.3;

fn bench() -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.freedom = Freedom::Clamped;
    model.sensors.wheel_speed.noise_stddev_rad_s = TACHOMETER_RAD_S;
    model.sensors.wheel_speed.quantum_rad_s = 0.0;
    model.jets_mut().clear();
    *model.wheels_mut() = vec![Wheel {
        name: "wheel_1".to_owned(),
        spin_axis_b: Unit::new_normalize(Vector3::z()),
        spin_inertia_kg_m2: SPIN_INERTIA_KG_M2,
        max_torque_n_m: 0.05,
        max_speed_rad_s: 500.0,
        viscous_friction_n_m_s: 0.0,
        coulomb_friction_n_m: 0.0,
    }];
    model
}

/// The wheel is driven up for ten seconds, then turned round. Its maker gives speeds as running means over so many samples.
fn ramp(torque_n_m: f64, seed: u64, together: usize) -> Recording {
    let mut random = Pcg64::new(u128::from(seed), 17);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut speed, mut motor) = (0.0_f64, 0.0);
    let mut r =
        Recording { name: format!("ramp_{seed}"), mounting: Mounting::Clamped, ..Recording::default() };
    for k in 0..4000 {
        let t = f64::from(k) * STEP_S;
        let wanted = if t < 10.0 { torque_n_m } else { -torque_n_m };
        motor += STEP_S * (wanted - motor) / CURRENT_S;
        r.wheel_speed_rad_s.time_s.push(t);
        r.wheel_speed_rad_s.value.push(vec![speed + TACHOMETER_RAD_S * normal()]);
        r.wheel_torque_command_n_m.time_s.push(t);
        r.wheel_torque_command_n_m.value.push(vec![motor]);
        let h = STEP_S / 20.0;
        for _ in 0..20 {
            let held = motor.clamp(-FRICTION_N_M, FRICTION_N_M);
            let friction = if speed == 0.0 { held } else { FRICTION_N_M * speed.signum() };
            let next = speed + h * (motor - friction) / SPIN_INERTIA_KG_M2;
            // It stops, and is held until the motor exceeds the friction.
            speed = if next * speed < 0.0 { 0.0 } else { next };
        }
    }
    let read = r.wheel_speed_rad_s.value.clone();
    for (k, smooth) in r.wheel_speed_rad_s.value.iter_mut().enumerate() {
        let some = &read[k.saturating_sub(together / 2)..(k + together / 2 + 1).min(read.len())];
        smooth[0] = some.iter().map(|speeds| speeds[0]).sum::<f64>() / some.len() as f64;
    }
    r
}

fn coulomb(fit: &Fit) -> (f64, f64) {
    let found = fit.estimates.iter().find(|p| p.group == EFFECT && p.name.contains("coulomb"));
    let found = found.unwrap_or_else(|| panic!("{:?}", fit.estimates));
    (found.estimate, found.stddev)
}

#[test]
fn the_friction_of_a_wheel_is_the_same_in_every_command() {
    every_command_agrees(1, 0.02);
}

/// Of 21 smoothed samples one says what all of them do.
#[test]
fn the_friction_of_a_wheel_is_the_same_in_every_command_where_its_speed_was_smoothed() {
    every_command_agrees(21, 0.05);
}

/// `least`: deviation that must be reached, over the friction.
fn every_command_agrees(together: usize, least: f64) {
    let of = |torque_n_m: f64, seed| ramp(torque_n_m, seed, together);
    let training = [of(7.5e-3, 1), of(10e-3, 2), of(15e-3, 3)];
    let held_out = [of(12.5e-3, 4)];
    let model = bench();
    let prior = ModelPrior::typical(&model);
    let case = Case { training: &training, held_out: &held_out, model: &model, prior: &prior };
    let options = Options::default();

    let fitted = fit(&training, &model, &prior, &[EFFECT], &options).unwrap();
    let (value, stddev) = coulomb(&fitted);
    println!("measured: fit {value:.3e} +- {stddev:.1e}");
    let adopted = adopt(&case, &[vec![EFFECT.to_owned()]], &options, &mut |_, _| {}).unwrap();
    let of_adoption = coulomb(adopted.versions.last().and_then(|v| v.fit.as_ref()).unwrap());
    println!("measured: adopt {:.3e} +- {:.1e}", of_adoption.0, of_adoption.1);
    let found = diagnose(&case, &options, &mut |_, _| {}).unwrap().diagnosis;
    println!("measured: diagnose {:?} {:?}", found.verdict, found.effects);
    let row = found.candidates.iter().find(|c| c.effect == EFFECT).unwrap();
    let said = row.parameters.iter().find(|p| p.name.contains("coulomb")).unwrap();
    println!("measured: diagnose {:.3e} +- {:.1e}", said.estimate, said.stddev);
    let next = &found.fits[&found.effects].model;

    assert_eq!(found.effects, [EFFECT]);
    assert_eq!(of_adoption, (value, stddev));
    // Fits of the same set may begin elsewhere.
    assert!((said.estimate - value).abs() < 0.1 * stddev && (said.stddev / stddev - 1.0).abs() < 0.05);
    assert!((next.wheels()[0].coulomb_friction_n_m - value).abs() < 0.1 * stddev, "{:?}", next.wheels());
    assert!((value - FRICTION_N_M).abs() < 4.0 * stddev && stddev < least * FRICTION_N_M);
}
