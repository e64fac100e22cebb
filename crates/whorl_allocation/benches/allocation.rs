//! Time of an allocation: the program with every kind of demand, the closed form, the oracle, a
//! pulse slot. The distribution over demands (p50, p99, worst) is printed first: criterion's mean
//! does not show it.

#![allow(missing_docs, reason = "criterion makes undocumented items")]
#![expect(clippy::expect_used, reason = "a bench may stop")]

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use rand_pcg::Pcg64;
use whorl_allocation::pulses::PulseModulator;
use whorl_allocation::zonotope::{LeastCost, Zonotope, jet_generators};
use whorl_allocation::{Allocator, Demand, EffectorLayout, Effectors, JetMask, Mode, Status};

#[path = "../src/layouts.rs"]
#[expect(dead_code, reason = "shared with the tests, which use more of it")]
mod layouts;

use layouts::{canted_pods, direction, no_wheels, three_wheels, uniform};

/// Demands as in the tests: every single-jet failure, about a quarter out of reach.
fn demands(effectors: &Effectors, mode: Mode, count: usize) -> Vec<Demand> {
    let mut rng = Pcg64::new(77, 7);
    let reach = if mode == Mode::Both { 7.0 } else { 3.0 };
    let full = effectors.layout().jet_torque_b_n_m.column(0).norm();
    (0..count)
        .map(|case| {
            let torque = direction(&mut rng) * (full * uniform(&mut rng, 0.0, reach));
            let mut demand = Demand::nominal(effectors, mode, torque);
            demand.jet_available = JetMask::ALL.without(case % (effectors.jets() + 1));
            demand.wheel_weight = 2.0;
            for desired in &mut demand.wheel_motor_torque_desired_n_m {
                *desired = uniform(&mut rng, -0.1, 0.1);
            }
            demand
        })
        .collect()
}

fn distribution(name: &str, effectors: &Effectors, mode: Mode) {
    let mut allocator = Allocator::new(effectors.clone()).expect("a valid program");
    let demands = demands(effectors, mode, 20_000);
    let (mut nanoseconds, mut short, mut fallbacks) = (Vec::new(), 0, 0);
    for demand in &demands[..1000] {
        black_box(allocator.allocate(demand).expect("a valid demand"));
    }
    for demand in &demands {
        // The best of three: what else the machine does is not the allocator's time.
        let mut best = u128::MAX;
        for _ in 0..3 {
            let start = Instant::now();
            let allocation = black_box(allocator.allocate(demand).expect("a valid demand"));
            let elapsed = start.elapsed().as_nanos();
            if best == u128::MAX {
                short += usize::from(allocation.alpha < 1.0);
                fallbacks += usize::from(matches!(allocation.status, Status::Fallback(_)));
            }
            best = best.min(elapsed);
        }
        nanoseconds.push(best);
    }
    nanoseconds.sort_unstable();
    let at = |share: f64| nanoseconds[((nanoseconds.len() - 1) as f64 * share) as usize] as f64 / 1e3;
    println!(
        "{name}: p50 {:.1} us, p99 {:.1} us, p99.9 {:.1} us, worst {:.1} us; {} demands, {short} out of \
         reach, {fallbacks} fallbacks",
        at(0.5),
        at(0.99),
        at(0.999),
        at(1.0),
        demands.len()
    );
}

fn allocation(criterion: &mut Criterion) {
    let both = canted_pods(three_wheels());
    let jets = canted_pods(no_wheels());
    distribution("program, 12 jets + 3 wheels", &both, Mode::Both);
    distribution("program, 12 jets", &jets, Mode::Jets);
    distribution("closed form, 3 wheels", &both, Mode::Wheels);

    let mut allocator = Allocator::new(both.clone()).expect("a valid program");
    let cases = demands(&both, Mode::Both, 1000);
    let mut next = 0;
    criterion.bench_function("program 12 jets + 3 wheels", |bencher| {
        bencher.iter(|| {
            next = (next + 1) % cases.len();
            allocator.allocate(black_box(&cases[next]))
        });
    });
    let cases = demands(&both, Mode::Wheels, 1000);
    criterion.bench_function("closed form 3 wheels", |bencher| {
        bencher.iter(|| {
            next = (next + 1) % cases.len();
            allocator.allocate(black_box(&cases[next]))
        });
    });

    let generators = jet_generators(&jets, JetMask::ALL);
    let rates = jets.layout().jet_gas_rate_kg_s.clone();
    let torque = Vector3::new(0.1, -0.2, 0.3);
    criterion.bench_function("oracle: build facets, 12 jets", |bencher| {
        bencher.iter(|| Zonotope::new(black_box(&generators), Vector3::zeros()));
    });
    criterion.bench_function("oracle: build least-cost table, 12 jets", |bencher| {
        bencher.iter(|| LeastCost::new(black_box(&generators), Vector3::zeros(), &rates));
    });
    let facets = Zonotope::new(&generators, Vector3::zeros());
    let table = LeastCost::new(&generators, Vector3::zeros(), &rates);
    criterion.bench_function("oracle: alpha and least gas from tables", |bencher| {
        bencher.iter(|| (facets.alpha_max(black_box(&torque)), table.of(black_box(&torque))));
    });

    let mut modulator = PulseModulator::new(&jets, vec![0.01; 12], 0.1).expect("valid");
    let fractions = [0.03, 0.0, 0.06, 0.2, 0.0, 0.0, 0.08, 0.0, 0.0, 0.0, 0.5, 0.0];
    criterion.bench_function("pulse slot, 12 jets", |bencher| {
        bencher.iter(|| modulator.modulate(black_box(&fractions)));
    });
}

criterion_group!(benches, allocation);
criterion_main!(benches);
