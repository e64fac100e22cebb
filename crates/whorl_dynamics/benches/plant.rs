//! Cost of one simulated second of Whorl-I: 1000 steps, 100 inertial samples.
#![allow(missing_docs, clippy::expect_used, reason = "a bench: criterion's macros, and a known platform")]

use std::collections::BTreeMap;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use whorl_dynamics::effects::written::{Definition, WrittenEffect, WrittenParameter};
use whorl_dynamics::effects::{Role, register};
use whorl_dynamics::{InitialState, Plant, PlatformModel};

fn with_effects(effects: &[(&str, &[(&str, f64)])]) -> PlatformModel {
    let mut model = PlatformModel::whorl_1_reference();
    for (id, values) in effects {
        let values: BTreeMap<String, f64> = values.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect();
        model.effects.insert((*id).to_owned(), values);
    }
    model
}

fn parameter(name: &str, unit: &str, range: (f64, f64), neutral: f64) -> WrittenParameter {
    WrittenParameter {
        name: name.into(),
        unit: unit.into(),
        range,
        neutral,
        prior: 0.1,
        role: if neutral == 0.0 { Role::Amplitude } else { Role::Shape },
        known: false,
        starts: Vec::new(),
        meaning: String::new(),
    }
}

fn friction() -> Definition {
    Definition {
        id: "written_friction".into(),
        equation: "-c * rate".into(),
        parameters: vec![parameter("c", "N m s", (0.0, 5.0), 0.0)],
        ..Definition::default()
    }
}

fn power_drag() -> Definition {
    Definition {
        id: "written_drag".into(),
        equation: "-d * (norm(rate) / 0.1 [rad/s])^p * unit(rate, 1e-12 [rad/s])".into(),
        parameters: vec![parameter("d", "N m", (0.0, 5.0), 0.0), parameter("p", "1", (1.0, 2.5), 1.5)],
        ..Definition::default()
    }
}

fn second(bencher: &mut criterion::Bencher<'_>, model: &PlatformModel, sampled: bool) {
    let initial = InitialState {
        omega_wb_b_rad_s: Vector3::new(0.01, -0.02, 0.1),
        wheel_speed_rad_s: vec![20.0, -30.0, 40.0],
        ..InitialState::default()
    };
    let fresh = Plant::new(model, &initial, 1).expect("the reference platform");
    bencher.iter_batched(
        || fresh.clone(),
        |mut plant| {
            for slot in 0..100_i64 {
                let now_ns = slot * 10_000_000;
                plant.command_wheels(&[0.1, -0.1, 0.05]).expect("three wheels");
                if slot % 2 == 0 {
                    for jet in [0, 5, 8] {
                        let _ = plant.command_jet_pulse(jet, now_ns, 0.0123);
                    }
                }
                plant.advance_to(now_ns + 10_000_000).expect("finite motion");
                if sampled {
                    black_box((plant.sample_imu(), plant.sample_wheels()));
                }
            }
            plant
        },
        criterion::BatchSize::SmallInput,
    );
}

fn plant(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("one simulated second");
    let base = PlatformModel::whorl_1_reference();
    group.bench_function("base, no samples", |b| second(b, &base, false));
    group.bench_function("base, sampled", |b| second(b, &base, true));
    let mut late = base.clone();
    late.sensors.gyro.errors.latency_s = 0.005;
    group.bench_function("base, sampled, late gyro", |b| second(b, &late, true));
    let three = with_effects(&[
        ("bearing_viscous_friction", &[("c_n_m_s", 0.02)]),
        ("air_current", &[("t_x_n_m", 0.003)]),
        ("thruster_rise", &[("tau_s", 0.004)]),
    ]);
    group.bench_function("three effects, sampled", |b| second(b, &three, true));
    // The same friction, compiled in and as data.
    let built_in = with_effects(&[("bearing_viscous_friction", &[("c_n_m_s", 0.02)])]);
    group.bench_function("a friction, built in", |b| second(b, &built_in, false));
    register(WrittenEffect::new(friction()).expect("a friction")).expect("a new id");
    let written = with_effects(&[("written_friction", &[("c", 0.02)])]);
    group.bench_function("a friction, written", |b| second(b, &written, false));
    let drag = with_effects(&[("air_drag_power", &[("d_n_m", 0.02), ("exponent", 1.7)])]);
    group.bench_function("a drag, built in", |b| second(b, &drag, false));
    register(WrittenEffect::new(power_drag()).expect("a drag")).expect("a new id");
    let written = with_effects(&[("written_drag", &[("d", 0.02), ("p", 1.7)])]);
    group.bench_function("a drag, written", |b| second(b, &written, false));
    group.finish();
}

criterion_group!(benches, plant);
criterion_main!(benches);
