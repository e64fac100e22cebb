//! Small rigs whose motion has a closed form or a few lines of its own here: a wheel that coasts down on a bench, and a
//! gimbal that turns about one axis under a controller.

use nalgebra::{Matrix3, Unit, Vector3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Freedom, MassProperties, ModelPrior, PlatformModel};
use whorl_identification::{Diagnosis, Options, Verdict, diagnose};
use whorl_recording::{Mounting, Recording, Series};

const STEP_S: f64 = 0.01;

/// A platform with one wheel about z and no jets.
#[expect(clippy::expect_used, reason = "a sphere is realisable")]
fn rig(freedom: Freedom, inertia_kg_m2: f64, wheel_kg_m2: f64) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.mass_properties = MassProperties::new(Matrix3::identity() * inertia_kg_m2, Vector3::zeros(), 1.0)
        .expect("a sphere is realisable");
    (model.freedom, model.tilt_limit) = (freedom, TiltLimit::NONE);
    model.jets_mut().clear();
    model.wheels_mut().truncate(1);
    let wheel = &mut model.wheels_mut()[0];
    wheel.spin_axis_b = Vector3::z_axis();
    (wheel.spin_inertia_kg_m2, wheel.max_torque_n_m, wheel.max_speed_rad_s) = (wheel_kg_m2, 0.02, 900.0);
    (wheel.viscous_friction_n_m_s, wheel.coulomb_friction_n_m) = (0.0, 0.0);
    let sensors = &mut model.sensors;
    (sensors.rate_hz, sensors.vector, sensors.accelerometer.fitted) = (1.0 / STEP_S, None, false);
    sensors.gyro.axes = [false, false, true];
    sensors.gyro.errors.noise_stddev = Vector3::repeat(1e-3);
    sensors.gyro.errors.bias_turn_on_stddev = Vector3::repeat(2e-3);
    sensors.wheel_speed.noise_stddev_rad_s = 0.1;
    model
}

#[expect(clippy::expect_used, reason = "a test fails by panicking")]
fn explained(runs: &[Recording], held_out: &[Recording], model: &PlatformModel) -> Diagnosis {
    diagnose(runs, held_out, model, &ModelPrior::typical(model), &Options::default(), &mut |_| {})
        .expect("the runs can be diagnosed")
}

fn estimate(found: &Diagnosis, effect: &str, parameter: &str) -> f64 {
    let rows = found.candidates.iter().filter(|c| c.effect == effect).flat_map(|c| &c.parameters);
    rows.filter(|p| p.name.ends_with(parameter)).map(|p| p.estimate).next().unwrap_or(f64::NAN)
}

/// A wheel of 1e-4 kg m^2 with dry friction alone: its speed falls along a straight line, to nothing in 3.5 s.
fn coast_down(seed: u64, from_rad_s: f64, friction_n_m: f64, model: &PlatformModel) -> Recording {
    let mut random = Pcg64::new(seed.into(), 3);
    let time_s: Vec<f64> = (0..400).map(|i| STEP_S * f64::from(i)).collect();
    let speed = |t: &f64| {
        let fall = friction_n_m / model.wheels()[0].spin_inertia_kg_m2 * t;
        let noise: f64 = StandardNormal.sample(&mut random);
        vec![from_rad_s.signum() * (from_rad_s.abs() - fall).max(0.0) + 0.1 * noise]
    };
    Recording {
        name: format!("coast_{seed}"),
        mounting: Mounting::Clamped,
        wheel_speed_rad_s: Series { value: time_s.iter().map(speed).collect(), time_s: time_s.clone() },
        wheel_torque_command_n_m: Series { value: vec![vec![0.0]; time_s.len()], time_s },
        ..Recording::default()
    }
}

#[test]
fn a_wheel_that_coasts_down_on_a_bench_has_dry_friction() {
    let model = rig(Freedom::Clamped, 1.0, 1e-4);
    let friction_n_m = 1e-4 * 100.0 / 3.5;
    let run = |seed, from| coast_down(seed, from, friction_n_m, &model);
    let found = explained(&[run(1, 100.0), run(2, -80.0)], &[run(3, 90.0)], &model);
    assert_eq!(found.verdict, Verdict::Named, "{:?} {:?}", found.unknown, found.explanations);
    assert_eq!(found.effects, ["wheel_friction"]);
    let coulomb_n_m = estimate(&found, "wheel_friction", "coulomb_n_m");
    assert!((coulomb_n_m / friction_n_m - 1.0).abs() < 0.05, "{coulomb_n_m} {friction_n_m}");
}

/// A gimbal of 5e-3 kg m^2 about a vertical shaft, its friction in proportion to the rate, that follows a slow swing by its
/// wheel: steps of 1 ms, commands every 10 ms.
fn gimbal(seed: u64, friction_n_m_s: f64, inertia_kg_m2: f64, wheel_kg_m2: f64) -> Recording {
    const STEPS: usize = 10;
    let mut random = Pcg64::new(seed.into(), 5);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let bias = 2e-3 * normal();
    let (slow_hz, fast_hz, size_rad) = (0.06 + 0.03 * seed as f64, 0.4 - 0.06 * seed as f64, 0.6);
    let mut recording = Recording {
        name: format!("gimbal_{seed}"),
        no_gyro_axis: [true, true, false],
        closed_loop: true,
        ..Recording::default()
    };
    let (mut angle, mut rate, mut speed, mut torque) = (0.0, 0.0, 0.0, 0.0_f64);
    for k in 0..60_000 {
        let time_s = STEP_S / STEPS as f64 * k as f64;
        if k % STEPS == 0 {
            let phase = std::f64::consts::TAU * time_s;
            let wanted = size_rad * ((slow_hz * phase).sin() + 0.4 * (fast_hz * phase).sin());
            torque = (-(0.02 * (wanted - angle) - 0.012 * rate)).clamp(-0.02, 0.02);
            recording.gyro_b_rad_s.time_s.push(time_s);
            recording.gyro_b_rad_s.value.push(Vector3::new(0.0, 0.0, rate + bias + 1e-3 * normal()));
            recording.wheel_speed_rad_s.time_s.push(time_s);
            recording.wheel_speed_rad_s.value.push(vec![speed + 0.1 * normal()]);
            recording.wheel_torque_command_n_m.time_s.push(time_s);
            recording.wheel_torque_command_n_m.value.push(vec![torque]);
        }
        // The motor turns wheel and body against each other; the wheel's inertia is part of the body's.
        let acceleration = (-torque - friction_n_m_s * rate) / (inertia_kg_m2 - wheel_kg_m2);
        rate += acceleration * 1e-3;
        angle += rate * 1e-3;
        speed += (torque / wheel_kg_m2 - acceleration) * 1e-3;
    }
    recording
}

/// The drawing's inertia is 2 % off, and the friction from none to four hundred times that of an air bearing.
#[test]
#[ignore = "slow: a gimbal with one gyro axis"]
fn a_gimbal_with_one_gyro_axis_tells_its_friction_and_that_it_lacks_nothing() {
    let (inertia_kg_m2, wheel_kg_m2) = (5e-3, 1e-4);
    let shaft = Freedom::Hinge { axis_b: Unit::new_normalize(Vector3::z()) };
    let model = rig(shaft, 1.02 * inertia_kg_m2, wheel_kg_m2);
    for friction_n_m_s in [0.0, 2e-4, 2e-3] {
        let run = |seed| gimbal(seed, friction_n_m_s, inertia_kg_m2, wheel_kg_m2);
        let found = explained(&[run(1), run(2)], &[run(3)], &model);
        if friction_n_m_s == 0.0 {
            assert_eq!(found.verdict, Verdict::NothingMissing, "{found:?}");
            continue;
        }
        assert_eq!(
            found.verdict,
            Verdict::Named,
            "{friction_n_m_s}: {:?} {:?}",
            found.effects,
            found.unknown
        );
        assert_eq!(found.effects, ["bearing_viscous_friction"]);
        let c_n_m_s = estimate(&found, "bearing_viscous_friction", "c_n_m_s");
        assert!((c_n_m_s / friction_n_m_s - 1.0).abs() < 0.01, "{c_n_m_s} {friction_n_m_s}");
        let of_gyro = found.noise.iter().filter(|n| n.channel == "gyro");
        assert!(
            of_gyro.clone().count() == 2 && of_gyro.clone().all(|n| (0.8..1.2).contains(&n.scale)),
            "{:?}",
            found.noise
        );
    }
}

/// Rate after a millisecond under a torque and dry friction: a body stops where its rate would change sign, and stands for
/// as long as friction holds it.
fn slid(rate_rad_s: f64, drive_n_m: f64, friction_n_m: f64, inertia_kg_m2: f64) -> f64 {
    if rate_rad_s == 0.0 && drive_n_m.abs() <= friction_n_m {
        return 0.0;
    }
    let sense = if rate_rad_s == 0.0 { drive_n_m } else { rate_rad_s }.signum();
    let next = rate_rad_s + (drive_n_m - friction_n_m * sense) / inertia_kg_m2 * 1e-3;
    if next * rate_rad_s < 0.0 { 0.0 } else { next }
}

/// A minute of a body on a shaft whose wheel is driven by slow waves and has dry friction: it comes to rest and sticks, breaks
/// loose and sticks again.
fn sticking(seed: u64, model: &PlatformModel, friction_n_m: f64) -> Recording {
    let mut random = Pcg64::new(seed.into(), 7);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let (bias, side) = (2e-3 * normal(), if seed.is_multiple_of(2) { 1.0 } else { -1.0 });
    let inertia_kg_m2 = model.mass_properties.inertia_b_kg_m2()[(2, 2)];
    let wheel_kg_m2 = model.wheels()[0].spin_inertia_kg_m2;
    let alone_kg_m2 = inertia_kg_m2 - wheel_kg_m2;
    let mut recording = Recording {
        name: format!("sticking_{seed}"),
        no_gyro_axis: [true, true, false],
        ..Recording::default()
    };
    let (mut rate, mut speed) = (0.1 * side, 15.0 * side);
    for k in 0..60_000 {
        let time_s = 1e-3 * f64::from(k);
        let wave = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * time_s + phase).sin();
        let torque =
            3e-4 * (wave(0.11 + 0.01 * seed as f64, 0.0) + wave(0.23, seed as f64) + 0.6 * wave(0.47, 1.0));
        if k % 10 == 0 {
            recording.gyro_b_rad_s.time_s.push(time_s);
            recording.gyro_b_rad_s.value.push(Vector3::new(0.0, 0.0, rate + bias + 1e-3 * normal()));
            recording.wheel_speed_rad_s.time_s.push(time_s);
            recording.wheel_speed_rad_s.value.push(vec![speed + 0.1 * normal()]);
            recording.wheel_torque_command_n_m.time_s.push(time_s);
            recording.wheel_torque_command_n_m.value.push(vec![torque]);
        }
        // What the wheel gains the body loses.
        let before = speed;
        speed = slid(speed, torque, friction_n_m, wheel_kg_m2 * alone_kg_m2 / inertia_kg_m2);
        rate -= wheel_kg_m2 / inertia_kg_m2 * (speed - before);
    }
    recording
}

/// A wheel that sticks has no law there: friction is whatever holds it. It must not count against the law.
#[test]
fn dry_friction_is_named_where_a_wheel_sticks() {
    let shaft = Freedom::Hinge { axis_b: Unit::new_normalize(Vector3::z()) };
    let model = rig(shaft, 0.1, 3e-4);
    let friction_n_m = 2e-4;
    let run = |seed| sticking(seed, &model, friction_n_m);
    let found = explained(&[run(1), run(2)], &[run(3)], &model);
    assert_eq!(found.verdict, Verdict::Named, "{:?} {:?}", found.explanations, found.unknown);
    assert_eq!(found.effects, ["wheel_friction"]);
    let ratio = estimate(&found, "wheel_friction", "coulomb_n_m") / friction_n_m;
    assert!((ratio - 1.0).abs() < 0.03, "{ratio}");
}
