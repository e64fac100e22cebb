//! Time of an allocation: the program with every kind of demand by the dual method and by the interior point, the
//! closed form, the oracle, a pulse slot. The comparison with its distribution over demands (p50, p99, worst) is printed
//! first: criterion's mean does not show it.

#![allow(missing_docs, reason = "criterion makes undocumented items")]
#![expect(clippy::expect_used, reason = "a bench may stop")]

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use rand_pcg::Pcg64;
use whorl_allocation::pulses::PulseModulator;
use whorl_allocation::zonotope::{LeastCost, Zonotope, jet_generators};
use whorl_allocation::{
    Allocation, Allocator, EffectorLayout, Effectors, JetMask, Mode, Status, TorqueDemand,
};

#[path = "../src/layouts.rs"]
mod layouts;

use layouts::{canted_pods, direction, eight_jets, no_wheels, six_jets, three_wheels, uniform, wheels_only};

/// What is asked of the allocator.
#[derive(Clone, Copy)]
enum Kind {
    /// Every single-jet failure, about a quarter out of reach.
    Random,
    /// Along the axes, where one or two jets give all the torque there is.
    Axes,
    /// Random bounds of jets and wheels, some jets stuck open: some exclude every share of the demand.
    Bounds,
    /// All far out of reach.
    Saturated,
}

fn demands(effectors: &Effectors, mode: Mode, kind: Kind, count: usize) -> Vec<TorqueDemand> {
    let mut rng = Pcg64::new(77, 7);
    let reach = if mode == Mode::Both { 7.0 } else { 3.0 };
    let full = effectors.layout().jet_torque_b_n_m.column_iter().map(|b| b.norm()).fold(0.2, f64::max);
    (0..count)
        .map(|case| {
            let along = match kind {
                Kind::Axes => {
                    let axis = [Vector3::x(), Vector3::y(), Vector3::z()][case % 3];
                    if case % 2 == 0 { axis } else { -axis }
                }
                _ => direction(&mut rng),
            };
            let size = match kind {
                Kind::Saturated => uniform(&mut rng, 10.0, 1e4),
                Kind::Axes => 10.0_f64.powf(uniform(&mut rng, -9.0, 2.0)),
                _ => uniform(&mut rng, 0.0, reach),
            };
            let mut demand = TorqueDemand::nominal(effectors, mode, along * (full * size));
            demand.jet_available = JetMask::ALL.without(case % (effectors.jets() + 1));
            demand.motor_weight = if case % 5 == 0 { 0.0 } else { 2.0 };
            for desired in &mut demand.motor_desired {
                *desired = uniform(&mut rng, -0.1, 0.1);
            }
            if matches!(kind, Kind::Bounds) {
                for j in 0..effectors.jets() {
                    demand.jet_on_fraction_max[j] = uniform(&mut rng, 0.0, 1.0);
                    if uniform(&mut rng, 0.0, 1.0) < 0.1 {
                        demand.jet_on_fraction_min[j] = demand.jet_on_fraction_max[j];
                    }
                }
                for i in 0..effectors.motors() {
                    let (a, b) = (uniform(&mut rng, -0.5, 0.3), uniform(&mut rng, -0.3, 0.5));
                    demand.motor_min[i] = a.min(b);
                    demand.motor_max[i] = a.max(b);
                }
            }
            demand
        })
        .collect()
}

/// Times of one method.
#[derive(Default)]
struct Times(Vec<u128>);

impl Times {
    /// The best of three, to exclude other load on the machine.
    fn measure(&mut self, allocator: &mut Allocator, demand: &TorqueDemand) -> Allocation {
        let (mut best, mut answer) = (u128::MAX, None);
        for _ in 0..3 {
            let start = Instant::now();
            let allocation = black_box(allocator.allocate(demand).expect("a valid demand"));
            best = best.min(start.elapsed().as_nanos());
            answer = Some(allocation);
        }
        self.0.push(best);
        answer.expect("three answers")
    }

    fn words(&mut self) -> String {
        self.0.sort_unstable();
        let at = |share: f64| self.0[((self.0.len() - 1) as f64 * share) as usize] as f64 / 1e3;
        format!("p50 {:.1} us, p99 {:.1} us, worst {:.1} us", at(0.5), at(0.99), at(1.0))
    }
}

/// The dual method without a start and the interior point, on the same demands.
fn compare(name: &str, effectors: &Effectors, mode: Mode, kind: Kind, count: usize) {
    let mut dual = Allocator::new(effectors.clone()).expect("a valid program");
    let mut interior = Allocator::new(effectors.clone()).expect("a valid program").by_interior_point();
    let demands = demands(effectors, mode, kind, count);
    let (mut dual_times, mut interior_times) = (Times::default(), Times::default());
    let (mut short, mut fallbacks, mut alone, mut refused) = (0, 0, 0, 0);
    let mut apart = 0.0_f64;
    for demand in &demands {
        let ours = dual_times.measure(&mut dual, demand);
        let theirs = interior_times.measure(&mut interior, demand);
        short += usize::from(ours.alpha < 1.0);
        match ours.status {
            Status::Fallback(_) => fallbacks += 1,
            Status::Solved { iterations, .. } => {
                alone += usize::from(iterations == 0);
                let check = dual.check(demand, &ours).expect("a valid demand");
                refused += usize::from(!check.agrees());
            }
            Status::ClosedForm => {}
        }
        let jets = ours.jet_on_fraction.iter().zip(&theirs.jet_on_fraction);
        let wheels = ours.motor_command.iter().zip(&theirs.motor_command);
        apart = jets.chain(wheels).map(|(a, b)| (a - b).abs()).fold(apart, f64::max);
    }
    println!(
        "{name}: {count} demands, {short} out of reach, {fallbacks} fallbacks; {alone} by the dual method alone, {refused} \
         not as the oracle says, answers apart by at most {apart:.1e}\n    dual first:     {}\n    interior point: {}",
        dual_times.words(),
        interior_times.words()
    );
}

fn allocation(criterion: &mut Criterion) {
    let both = canted_pods(three_wheels());
    let jets = canted_pods(no_wheels());
    let kinds = [
        ("random", Kind::Random),
        ("along axes", Kind::Axes),
        ("random bounds", Kind::Bounds),
        ("saturated", Kind::Saturated),
    ];
    let pyramid = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| Vector3::new(x, y, 1.0));
    for (word, kind) in kinds {
        compare(&format!("12 jets + 3 wheels, {word}"), &both, Mode::Both, kind, 5000);
        compare(&format!("12 jets, {word}"), &jets, Mode::Jets, kind, 5000);
        compare(&format!("8 jets, {word}"), &eight_jets(no_wheels()), Mode::Jets, kind, 3000);
        compare(&format!("6 jets + 3 wheels, {word}"), &six_jets(three_wheels()), Mode::Both, kind, 3000);
        compare(&format!("4 wheels, {word}"), &wheels_only(&pyramid, 0.2), Mode::Motors, kind, 3000);
    }
    compare("closed form, 3 wheels", &both, Mode::Motors, Kind::Random, 3000);

    let mut allocator = Allocator::new(both.clone()).expect("a valid program");
    let cases = demands(&both, Mode::Both, Kind::Random, 1000);
    let mut next = 0;
    criterion.bench_function("dual first, 12 jets + 3 wheels", |bencher| {
        bencher.iter(|| {
            next = (next + 1) % cases.len();
            allocator.allocate(black_box(&cases[next]))
        });
    });
    let mut interior = Allocator::new(both.clone()).expect("a valid program").by_interior_point();
    criterion.bench_function("interior point, 12 jets + 3 wheels", |bencher| {
        bencher.iter(|| {
            next = (next + 1) % cases.len();
            interior.allocate(black_box(&cases[next]))
        });
    });
    let cases = demands(&both, Mode::Motors, Kind::Random, 1000);
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
