//! Innovations change with every parameter of every effect of the catalogue as the columns say: against whole passes of the filter with
//! the parameter to either side.

#![expect(clippy::unwrap_used, reason = "a test stops at a broken precondition")]

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;
use whorl_dynamics::actuators::ActuatorKind;
use whorl_dynamics::effects::{Effect, ParameterSpec, Role, built_in};
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{InitialState, Plant, PlatformModel};
use whorl_prediction::{
    Noise, Prepared, Settings, Start, Told, Varied, fitted_start, predict, sensitivities,
};
use whorl_recording::{OnInterval, Recording, VectorChannel};

const RATE_HZ: i64 = 50;
const SAMPLES: i64 = 200;
/// From a model to the varied one, in prior standard deviations.
const STEP: f64 = 1e-3;
/// How far apart innovations are of which differences are taken, root mean square of their own deviations.
const APART: f64 = 0.3;

/// The same of a frequency or a phase that may be anywhere in its range, in which a signal goes round many times.
const STEP_ANYWHERE: f64 = 1e-6;
/// Effects that change no innovation of this recording, and why.
const SILENT: [(&str, &str); 4] = [
    ("tilt_stop_contact", "nothing touches; between plants of which one touches there is no derivative"),
    (
        "gimbal_friction",
        "the gimbals' motion is taken as it was measured; their motors' torques are no innovations",
    ),
    ("gyro_saturation", "readings at a limit are left out, and there are none"),
    ("unmodelled_torque", "it widens what is predicted and does not move it"),
];

/// Whorl-I with two of its jets, its wheels and, where columns are to take whole steps with it, a control moment gyro: every effect has its
/// part.
fn platform(has_gyro: bool) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    model.tilt_limit = TiltLimit::Cone { max_rad: 0.6 };
    model.jets_mut().truncate(2);
    for wheel in model.wheels_mut() {
        wheel.coulomb_friction_n_m = 0.0;
    }
    model.sensors.rate_hz = RATE_HZ as f64;
    if !has_gyro {
        return model;
    }
    model.actuators.control_moment_gyros.add("cmg".to_owned());
    let gyro = model.gyros_mut().last_mut().unwrap();
    (gyro.gimbal_axis_b, gyro.spin_axis_b) =
        (Unit::new_normalize(Vector3::new(0.3, 1.0, -0.2)), Unit::new_normalize(Vector3::x()));
    (gyro.rotor_momentum_n_m_s, gyro.gimbal_inertia_kg_m2) = (0.15, 4e-3);
    (gyro.max_rate_rad_s, gyro.max_angle_rad, gyro.time_constant_s) = (1.0, 6.0, 4e-3);
    model
}

/// Largest step to either side.
fn margin(spec: &ParameterSpec) -> f64 {
    (0.1 * spec.prior_stddev).min(0.1 * (spec.max - spec.min))
}

/// One prior standard deviation off neutral, or in the middle of the range if that is narrower.
fn present(spec: &ParameterSpec) -> f64 {
    let inside = |x: &f64| x - margin(spec) >= spec.min && x + margin(spec) <= spec.max;
    let sides = [spec.neutral + spec.prior_stddev, spec.neutral - spec.prior_stddev];
    if spec.known {
        spec.neutral
    } else {
        sides.into_iter().find(inside).unwrap_or(0.5 * (spec.min + spec.max))
    }
}

fn with(effect: &dyn Effect, values: &BTreeMap<String, f64>, has_gyro: bool) -> PlatformModel {
    let mut model = platform(has_gyro);
    model.effects.insert(effect.info().id.to_owned(), values.clone());
    model
}

/// Four seconds in which everything is used.
fn record(truth: &PlatformModel) -> Recording {
    let start = InitialState {
        q_world_body: UnitQuaternion::from_euler_angles(0.05, -0.03, 0.4),
        omega_wb_b_rad_s: Vector3::new(0.06, -0.05, 0.15),
        wheel_speed_rad_s: vec![30.0, -40.0, 50.0],
        ..InitialState::default()
    };
    let mut plant = Plant::new(truth, &start, 5).unwrap();
    let mut r = Recording { name: "used".to_owned(), ..Recording::default() };
    r.jet_pulses = vec![Vec::new(); truth.jets().len()];
    let mut directions = Vec::new();
    let gimbal = |k: i64| 0.8 * (TAU * 0.3 * k as f64 / RATE_HZ as f64).sin();
    for k in 0..SAMPLES {
        let (t, now_ns) = (k as f64 / RATE_HZ as f64, k * 1_000_000_000 / RATE_HZ);
        plant.advance_to(now_ns).unwrap();
        let imu = plant.sample_imu();
        r.gyro_b_rad_s.time_s.push(t);
        r.gyro_b_rad_s.value.push(imu.angular_velocity_rad_s);
        r.specific_force_b_m_s2.time_s.push(t);
        r.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        r.wheel_speed_rad_s.time_s.push(t);
        r.wheel_speed_rad_s.value.push(plant.sample_wheels().iter().map(|w| w.speed_rad_s).collect());
        if k % 5 == 0 {
            directions.push((t, plant.sample_vector().unwrap().direction.into_inner()));
        }
        if !truth.gyros().is_empty() {
            r.gimbal_angle_rad.time_s.push(t);
            r.gimbal_angle_rad.value.push(vec![gimbal(k)]);
            let rate = (gimbal(k + 1) - gimbal(k)) * RATE_HZ as f64;
            plant.move_gimbals_along(&[gimbal(k)], &[rate]).unwrap();
        }
        let torque: Vec<f64> = (0..3).map(|j| 0.1 * (TAU * (0.2 + 0.15 * f64::from(j)) * t).sin()).collect();
        plant.command_wheels(&torque).unwrap();
        r.wheel_torque_command_n_m.time_s.push(t);
        r.wheel_torque_command_n_m.value.push(torque);
        let ballast = Vector3::new(0.05 * (0.9 * t).sin(), 0.05 * (1.3 * t).cos(), 0.02 * (0.7 * t).sin());
        plant.set_ballast_moment(ballast);
        r.ballast_moment_b_n_m.time_s.push(t);
        r.ballast_moment_b_n_m.value.push(ballast);
        if k % 25 == 10 {
            let jet = usize::from(k % 50 == 10);
            let on_s = 0.1;
            plant.command_jet_pulse(jet, now_ns, on_s).unwrap();
            r.jet_pulses[jet].push(OnInterval { on_s: t, off_s: t + on_s });
        }
    }
    let reference_world = truth.sensors.vector.unwrap().reference_direction_world;
    r.vectors.push(VectorChannel { reference_world, direction_b: directions.into_iter().collect() });
    r
}

/// Innovations of a whole pass.
fn innovations(
    recording: &Recording,
    model: &PlatformModel,
    noise: &Noise,
    start: &Start,
    settings: Settings,
) -> Vec<f64> {
    let case = Prepared::new(recording, model, settings).unwrap();
    let mut values = Vec::new();
    predict(&case, noise, start, &[], &mut |told| {
        if let Told::Innovation(e) = told {
            values.push(e.value);
        }
    });
    values
}

/// Of each fitted parameter of an effect: name, how large its column is and how far off, both over the root of the number of innovations.
fn judged(effect: &dyn Effect, has_gyro: bool) -> Vec<(String, f64, f64)> {
    // Where derivatives that are held are made anew depends on the model: a jump, and no derivative.
    let settings = Settings { derivatives_held: 0.0, ..Settings::default() };
    let specs = effect.parameters(&platform(has_gyro));
    let values: BTreeMap<String, f64> = specs.iter().map(|spec| (spec.name.clone(), present(spec))).collect();
    let model = with(effect, &values, has_gyro);
    let recording = record(&model);
    let case = Prepared::new(&recording, &model, settings).unwrap();
    let noise = Noise::stated(&case).unwrap();
    let start = fitted_start(&case, &noise).start;
    let fitted: Vec<&ParameterSpec> = specs.iter().filter(|spec| !spec.known).collect();
    let along = |spec: &ParameterSpec, step: f64| {
        let mut moved = values.clone();
        *moved.get_mut(&spec.name).unwrap() += step;
        with(effect, &moved, has_gyro)
    };
    let step_of = |spec: &ParameterSpec| {
        let share = if spec.role == Role::FloatingShape { STEP_ANYWHERE } else { STEP };
        share * spec.prior_stddev
    };
    let varied: Vec<Varied> =
        fitted.iter().map(|spec| Varied { model: along(spec, step_of(spec)), step: step_of(spec) }).collect();
    let mut found = Vec::new();
    sensitivities(&case, &noise, &start, &varied, &mut |e, d| found.push((*e, d / e.stddev))).unwrap();
    let root_n = (found.len() as f64).sqrt();
    let judge = |(k, spec): (usize, &&ParameterSpec)| {
        let size = found.iter().map(|(_, d)| d[k].powi(2)).sum::<f64>().sqrt();
        let step = (APART * root_n / size).min(margin(spec));
        let [plus, minus] =
            [step, -step].map(|step| innovations(&recording, &along(spec, step), &noise, &start, settings));
        let off = plus
            .iter()
            .zip(&minus)
            .zip(&found)
            .map(|((plus, minus), (e, d))| (d[k] - (plus - minus) / (2.0 * step) / e.stddev).powi(2));
        let scale = spec.prior_stddev / root_n;
        (spec.name.clone(), size * scale, off.sum::<f64>().sqrt() * scale)
    };
    fitted.iter().enumerate().map(judge).collect()
}

#[test]
fn innovations_change_with_every_parameter_as_the_columns_say() {
    let (mut count, mut bad) = (0, Vec::new());
    let gimbals = |effect: &dyn Effect| {
        let parts = |has_gyro: bool| effect.parameters(&platform(has_gyro)).len();
        parts(true) != parts(false)
    };
    // A platform without gimbals is stepped only where a valve moves.
    let both: Vec<(&dyn Effect, bool)> = built_in()
        .iter()
        .flat_map(|effect| [(*effect, true), (*effect, false)])
        .filter(|(effect, has_gyro)| *has_gyro || !gimbals(*effect))
        .collect();
    let all: Vec<_> = both.par_iter().map(|(effect, has_gyro)| judged(*effect, *has_gyro)).collect();
    for ((effect, has_gyro), judged) in both.into_iter().zip(all) {
        let id = effect.info().id;
        let is_silent = SILENT.iter().any(|(silent, _)| *silent == id);
        for (name, size, off) in judged {
            count += 1;
            // Gains move with the parameters too, in innovations of size one.
            if off > 0.03 * size + 0.05 || is_silent != (size < 1e-6) {
                bad.push(format!("{id} {name}, gyro {has_gyro}: column {size:.3e}, off by {off:.3e}"));
            }
        }
    }
    println!("measured: {count} parameters of {} effects", built_in().len());
    assert!(bad.is_empty(), "{bad:#?}");
}
