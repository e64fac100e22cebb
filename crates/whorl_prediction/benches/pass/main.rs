//! Processor time of an instant of a pass over six minutes at 100 Hz: gains, the mean with gains that were kept, and columns of parameters.
#![allow(missing_docs, clippy::expect_used, reason = "a bench: criterion's macros, and a known platform")]

mod processor;

use std::collections::BTreeMap;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use processor::{ProcessorTime, instants};
use whorl_dynamics::effects::{Role, catalogue};
use whorl_dynamics::platform::TiltLimit;
use whorl_dynamics::{Gyrostat, InitialState, Plant, PlatformModel};
use whorl_prediction::{
    Disturbance, Laws, Noise, Prepared, Push, RandomTorque, Settings, Start, Varied, fitted_start, follow,
    frozen_gains, hints, innovations, predict, sensitivities,
};
use whorl_recording::{OnInterval, Recording};

const SAMPLES: i64 = 36_000;
const STEP_NS: i64 = 10_000_000;
const PARAMETERS: usize = 150;
const LAWS: usize = 500;
/// Share of a parameter's prior over which differences are taken.
const SHARE: f64 = 1e-3;

/// Wheels driven by sines, and a jet's pulse twice a second.
fn recording(model: &PlatformModel) -> Recording {
    let start = InitialState { omega_wb_b_rad_s: Vector3::new(0.02, -0.03, 0.1), ..InitialState::default() };
    let mut plant = Plant::new(model, &start, 1).expect("the platform of the tests");
    let mut r = Recording { name: "six minutes".to_owned(), ..Recording::default() };
    r.jet_pulses = vec![Vec::new(); model.jets().len()];
    for k in 0..SAMPLES {
        let (now_ns, t) = (k * STEP_NS, k as f64 * 0.01);
        plant.advance_to(now_ns).expect("a motion without end");
        let imu = plant.sample_imu();
        r.gyro_b_rad_s.time_s.push(t);
        r.gyro_b_rad_s.value.push(imu.angular_velocity_rad_s);
        r.specific_force_b_m_s2.time_s.push(t);
        r.specific_force_b_m_s2.value.push(imu.specific_force_m_s2);
        r.wheel_speed_rad_s.time_s.push(t);
        r.wheel_speed_rad_s.value.push(plant.sample_wheels().iter().map(|wheel| wheel.speed_rad_s).collect());
        let wheels = model.wheels().iter().enumerate();
        let command: Vec<f64> = wheels
            .map(|(j, wheel)| 0.2 * wheel.max_torque_n_m * ((0.3 + 0.17 * j as f64) * t).sin())
            .collect();
        plant.command_wheels(&command).expect("within limits");
        r.wheel_torque_command_n_m.time_s.push(t);
        r.wheel_torque_command_n_m.value.push(command);
        let jet = (k / 50) as usize % model.jets().len();
        if k % 50 == 0 && plant.command_jet_pulse(jet, now_ns, 0.05).is_ok() {
            r.jet_pulses[jet].push(OnInterval { on_s: t, off_s: t + 0.05 });
        }
    }
    r
}

/// Models a little further along parameters of the catalogue, the first of them once more where there are fewer.
fn varied(model: &PlatformModel) -> Vec<Varied> {
    let mut all = Vec::new();
    for effect in catalogue().iter().filter(|effect| effect.hidden_states(model) == 0) {
        let specs = effect.parameters(model);
        for spec in specs.iter().filter(|spec| spec.role == Role::Amplitude && !spec.known) {
            let step = SHARE * spec.prior_stddev;
            let mut moved = model.clone();
            let values = BTreeMap::from([(spec.name.clone(), (spec.neutral + step).min(spec.max))]);
            moved.effects.insert(effect.info().id.to_owned(), values);
            if Gyrostat::new(&moved).is_ok() {
                all.push(Varied { model: moved, step });
            }
        }
    }
    all.into_iter().cycle().take(PARAMETERS).collect()
}

fn pass(c: &mut Criterion<ProcessorTime>) {
    // It swings freely: while the bearing's stop touches, columns take whole steps.
    let model = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
    let recording = recording(&model);
    let case = Prepared::new(&recording, &model, Settings::default()).expect("a recording of this model");
    let stated = Noise::stated(&case).expect("sensors with noise");
    // A state with everything: random torques, noise of the motors.
    let body = vec![RandomTorque { stddev_b_n_m: [1e-3; 3], correlation_s: 1.0 }];
    let disturbance = Disturbance { body, motors_n_m: vec![1e-4; 3], motors_correlation_s: 1.0 };
    let noise = Noise { disturbance, ..stated };
    let start: Start = fitted_start(&case, &noise).start;
    let varied = varied(&model);
    let gains = frozen_gains(&case, &noise, &start).expect("a motion without end");
    let mut group = c.benchmark_group("an instant of six minutes at 100 Hz");
    group.throughput(instants(SAMPLES));
    group.sample_size(10);
    group.bench_function("gains and mean", |b| {
        b.iter(|| black_box(predict(&case, &noise, &start, &[], &mut |_| {})));
    });
    group.bench_function("mean with frozen gains", |b| {
        b.iter(|| black_box(innovations(&case, &noise, &start, &gains, &mut |_| {})));
    });
    for columns in [64, PARAMETERS] {
        group.bench_function(format!("with {columns} columns"), |b| {
            b.iter(|| {
                let found = sensitivities(&case, &noise, &start, &varied[..columns], &mut |_, d| {
                    black_box(d[0]);
                });
                found.expect("models of platforms");
            });
        });
    }
}

/// Laws of the rate, its products and the speeds of wheels, about each axis: a column each.
fn laws() -> Laws<'static> {
    Laws::new(LAWS, 3, |plant, pushes| {
        let (rate, speeds) = (plant.state().omega_wb_b_rad_s, plant.state().wheel_speed_rad_s());
        pushes.extend((0..LAWS).map(|k| {
            let of_wheel = speeds.get(k / 3 % speeds.len().max(1)).copied().unwrap_or(0.0);
            let size = rate[k % 3] * rate[k / 3 % 3] + 1e-3 * of_wheel * (1.0 + k as f64 / LAWS as f64);
            Push::Body(Vector3::ith(k % 3, size))
        }));
    })
}

/// Columns of many laws at once.
fn many(c: &mut Criterion<ProcessorTime>) {
    let model = PlatformModel { tilt_limit: TiltLimit::NONE, ..PlatformModel::whorl_1_reference() };
    let recording = recording(&model);
    let case = Prepared::new(&recording, &model, Settings::default()).expect("a recording of this model");
    let followed = [follow(&case, &Noise::stated(&case).expect("sensors with noise"))];
    let (recordings, laws) = ([recording.clone()], [laws()]);
    let model_at = |_: &[f64]| Some(model.clone());
    let mut group = c.benchmark_group("an instant of six minutes at 100 Hz");
    group.throughput(instants(SAMPLES));
    group.sample_size(10);
    group.bench_function(format!("with {LAWS} columns of laws"), |b| {
        b.iter(|| {
            let found = hints(&recordings, &[], &model_at, &[], &followed, &laws, &Settings::default());
            black_box(found.expect("a model of the platform"));
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().with_measurement(ProcessorTime);
    targets = pass, many
}
criterion_main!(benches);
