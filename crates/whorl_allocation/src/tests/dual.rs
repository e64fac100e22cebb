//! The dual method without a start against the interior point: both must find the same optimum.

use nalgebra::Vector3;
use rand_pcg::Pcg64;

use crate::layouts::{
    canted_pods, direction, eight_jets, no_wheels, six_jets, three_wheels, uniform, wheels_only,
};
use crate::{Allocator, Effectors, JetMask, Mode, Status, TorqueDemand};

/// Objective of the program at an allocation: gas in units of the thirstiest jet, and missed wheel torque.
fn cost(effectors: &Effectors, demand: &TorqueDemand, jets: &[f64], wheels: &[f64]) -> f64 {
    let layout = effectors.layout();
    let rates = &layout.jet_gas_rate_kg_s;
    let most = rates.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let gas: f64 = jets.iter().zip(rates).map(|(u, rate)| u * rate / most).sum();
    let missed = wheels.iter().zip(&demand.motor_desired).zip(&layout.motor_limit);
    let missed: f64 = missed.map(|((w, desired), limit)| ((w - desired) / limit).powi(2)).sum();
    gas + 0.5 * demand.motor_weight * missed
}

/// A demand with bounds, failures and prices of every kind.
fn demand(effectors: &Effectors, mode: Mode, rng: &mut Pcg64, case: usize) -> TorqueDemand {
    let size = [1e-6, 0.05, 0.3, 1.5, 1e3][case % 5];
    let along = if case.is_multiple_of(3) { Vector3::ith(case % 9 / 3, 1.0) } else { direction(rng) };
    let mut demand = TorqueDemand::nominal(effectors, mode, along * (size * uniform(rng, 0.5, 1.0)));
    demand.jet_available = JetMask::ALL.without(case % (effectors.jets() + 1));
    demand.motor_weight = [0.0, 0.01, 2.0, 1e4][case % 4];
    for desired in &mut demand.motor_desired {
        *desired = uniform(rng, -0.2, 0.2);
    }
    if case.is_multiple_of(2) {
        for j in 0..effectors.jets() {
            demand.jet_on_fraction_max[j] = uniform(rng, 0.0, 1.0);
            if uniform(rng, 0.0, 1.0) < 0.1 {
                demand.jet_on_fraction_min[j] = demand.jet_on_fraction_max[j];
            }
        }
        for i in 0..effectors.motors() {
            demand.motor_min[i] = uniform(rng, -0.5, 0.1);
            demand.motor_max[i] = uniform(rng, 0.1, 0.5);
        }
    }
    demand
}

#[test]
fn both_ways_end_at_the_same_optimum() {
    let pyramid = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| Vector3::new(x, y, 1.0));
    let mut rng = Pcg64::new(60, 7);
    let (mut alone, mut solved, mut fallbacks) = (0, 0, 0);
    for (effectors, mode) in [
        (canted_pods(three_wheels()), Mode::Both),
        (canted_pods(no_wheels()), Mode::Jets),
        (eight_jets(three_wheels()), Mode::Both),
        (six_jets(no_wheels()), Mode::Jets),
        (wheels_only(&pyramid, 0.2), Mode::Motors),
    ] {
        let mut dual = Allocator::new(effectors.clone()).unwrap();
        let mut interior = Allocator::new(effectors.clone()).unwrap().by_interior_point();
        for case in 0..720 {
            let demand = demand(&effectors, mode, &mut rng, case);
            let ours = dual.allocate(&demand).unwrap();
            let theirs = interior.allocate(&demand).unwrap();
            let (a, b) = [&ours, &theirs]
                .map(|x| cost(&effectors, &demand, &x.jet_on_fraction, &x.motor_command))
                .into();
            match (ours.status, theirs.status) {
                (Status::Solved { iterations, exact }, Status::Solved { iterations: more, .. }) => {
                    solved += 1;
                    alone += usize::from(iterations == 0 && exact);
                    assert!(more > 0, "the interior point did not answer: {theirs:?}");
                    assert!((a - b).abs() < 1e-6 * (1.0 + b), "{a} {b}: {ours:?} {theirs:?}");
                    let check = dual.check(&demand, &ours).unwrap();
                    assert!(check.torque_error < 1e-9 && check.bound_violation <= 0.0, "{check:?}");
                }
                (Status::Fallback(one), Status::Fallback(other)) => {
                    assert_eq!(one, other);
                    fallbacks += 1;
                }
                (one, other) => assert_eq!(one, other),
            }
        }
    }
    println!("{solved} solved, {alone} by the dual method alone, {fallbacks} fallbacks");
    assert!(solved > 2000 && fallbacks > 100, "{solved} {fallbacks}");
    assert!(alone * 1000 >= solved * 999, "{alone} of {solved}");
}

#[test]
fn net_force_is_for_the_interior_point() {
    let effectors = canted_pods(no_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::new(0.1, 0.05, -0.08));
    assert!(matches!(
        allocator.allocate(&demand).unwrap().status,
        Status::Solved { iterations: 0, exact: true }
    ));
    demand.net_force_weight = 1.0;
    let status = allocator.allocate(&demand).unwrap().status;
    assert!(matches!(status, Status::Solved { iterations: 1.., exact: false }), "{status:?}");
}
