//! The quadratic program against the oracle. Both use the same scaling of the demand, and the allocator takes the
//! share alpha from the oracle, so alpha is checked by a separate dual program.

use nalgebra::{Matrix3, Matrix3xX, Vector3};
use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::layouts::{
    canted_pods, direction, eight_jets, no_wheels, six_jets, three_wheels, uniform, wheels_only,
};
use crate::zonotope::LeastCost;
use crate::{Allocator, EffectorLayout, Effectors, FallbackReason, JetMask, Mode, Status, TorqueDemand};

/// Random demand up to `reach` times the strongest jet, every failure mode in turn.
fn jets_only_sweep(effectors: &Effectors, cases: usize, reach: f64, seed: u128) -> Sweep {
    let mut rng = Pcg64::new(seed, 7);
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let full = effectors.layout().jet_torque_b_n_m.column_iter().map(|b| b.norm()).fold(0.0, f64::max);
    let mut sweep = Sweep::default();
    for case in 0..cases {
        let failed = case % (effectors.jets() + 1);
        let torque = direction(&mut rng) * (full * uniform(&mut rng, 0.0, reach));
        let mut demand = TorqueDemand::nominal(effectors, Mode::Jets, torque);
        demand.jet_available = JetMask::ALL.without(failed);
        let allocation = allocator.allocate(&demand).unwrap();
        let check = allocator.check(&demand, &allocation).unwrap();
        assert!(check.bound_violation <= 0.0, "{check:?}");
        assert!(failed == effectors.jets() || allocation.jet_on_fraction[failed] == 0.0);
        match allocation.status {
            Status::Solved { exact, iterations } => {
                sweep.solved += 1;
                sweep.exact += usize::from(exact);
                sweep.iterations = sweep.iterations.max(iterations);
                assert!(check.agrees(), "case {case}: {check:?} {allocation:?}");
                let gas = check.gas_rate_kg_s / check.least_gas_rate_kg_s.max(1e-12);
                sweep.gas = sweep.gas.max(gas);
                sweep.torque_error = sweep.torque_error.max(check.torque_error);
                // What the effectors give is attainable; the dual program shows that no more is.
                let most = largest_share(effectors, &demand);
                let given = allocation.achieved_torque_b_n_m.dot(&torque) / torque.norm_squared();
                sweep.alpha_error = sweep.alpha_error.max((given - most).abs());
                sweep.alpha_error = sweep.alpha_error.max((allocation.alpha - most).abs());
                if allocation.alpha < 1.0 {
                    sweep.unattainable += 1;
                    let achieved = allocation.achieved_torque_b_n_m;
                    let angle = achieved.cross(&torque).norm() / achieved.norm() / torque.norm();
                    sweep.angle = sweep.angle.max(angle);
                }
            }
            Status::ClosedForm => panic!("jets are never unique here"),
            Status::Fallback(reason) => {
                assert_eq!(reason, FallbackReason::DirectionUnattainable);
                assert!(check.alpha_max.unwrap() * torque.norm() < 1e-8 * full);
                sweep.fallbacks += 1;
            }
        }
    }
    sweep
}

/// Largest share alpha of the demand that jets open between 0 and 1 can give, by the dual of that linear program:
/// the least of sum max(0, n'b_j) over the n with n'tau = 1, which is reached on a normal of two columns.
fn largest_share(effectors: &Effectors, demand: &TorqueDemand) -> f64 {
    let tau = demand.torque_b_n_m;
    let jets: Vec<Vector3<f64>> = (0..effectors.jets())
        .filter(|j| demand.jet_available.contains(*j))
        .map(|j| effectors.layout().jet_torque_b_n_m.column(j).into_owned())
        .collect();
    let mut least = 1.0_f64;
    for (i, a) in jets.iter().enumerate() {
        for b in &jets[..i] {
            let normal = a.cross(b);
            let along = normal.dot(&tau);
            if along.abs() > 1e-9 * a.norm() * b.norm() * tau.norm() {
                least = least.min(jets.iter().map(|c| (normal.dot(c) / along).max(0.0)).sum());
            }
        }
    }
    least
}

#[derive(Debug, Default)]
struct Sweep {
    solved: usize,
    exact: usize,
    unattainable: usize,
    fallbacks: usize,
    iterations: u32,
    gas: f64,
    torque_error: f64,
    alpha_error: f64,
    angle: f64,
}

#[test]
fn canted_jets_meet_the_oracle_with_every_single_failure() {
    let sweep = jets_only_sweep(&canted_pods(no_wheels()), 5200, 3.0, 1);
    println!("{sweep:?}");
    assert_eq!(sweep.solved, 5200, "all directions stay attainable: {sweep:?}");
    assert!(sweep.unattainable > 800, "{sweep:?}");
    assert!(sweep.torque_error < 1e-9 && sweep.alpha_error < 1e-9 && sweep.angle < 1e-9, "{sweep:?}");
    assert!(sweep.gas < 1.001, "{sweep:?}");
    assert!(sweep.exact * 100 >= sweep.solved * 99, "{sweep:?}");
}

#[test]
fn couples_and_one_sided_jets_meet_the_oracle() {
    for (effectors, seed) in [(eight_jets(no_wheels()), 2), (six_jets(no_wheels()), 3)] {
        let sweep = jets_only_sweep(&effectors, 1500, 2.5, seed);
        println!("{sweep:?}");
        assert!(sweep.torque_error < 1e-9 && sweep.alpha_error < 1e-9 && sweep.angle < 1e-9, "{sweep:?}");
        assert!(sweep.gas < 1.001 && sweep.solved > 800, "{sweep:?}");
    }
}

#[test]
fn demands_along_an_axis_are_degenerate_and_still_exact() {
    // One or two jets give all the torque there is: the basis is degenerate.
    for effectors in [eight_jets(no_wheels()), six_jets(no_wheels()), canted_pods(no_wheels())] {
        let mut allocator = Allocator::new(effectors.clone()).unwrap();
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            for size in [-1e3, -0.7, -0.24, -1e-4, 1e-9, 1e-6, 0.1, 0.24, 0.48, 5.0] {
                let demand = TorqueDemand::nominal(&effectors, Mode::Jets, axis * size);
                let allocation = allocator.allocate(&demand).unwrap();
                let check = allocator.check(&demand, &allocation).unwrap();
                assert!(matches!(allocation.status, Status::Solved { .. }), "{size}: {allocation:?}");
                assert!(check.agrees(), "{axis:?} {size}: {check:?} {allocation:?}");
            }
        }
    }
}

#[test]
fn bounds_on_jets_and_wheels_meet_the_oracle() {
    let effectors = canted_pods(three_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut rng = Pcg64::new(4, 7);
    let (mut solved, mut excluded) = (0, 0);
    for _ in 0..1500 {
        let torque = direction(&mut rng) * uniform(&mut rng, 0.0, 1.5);
        let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, torque);
        for j in 0..effectors.jets() {
            demand.jet_on_fraction_max[j] = uniform(&mut rng, 0.0, 1.0);
            if uniform(&mut rng, 0.0, 1.0) < 0.1 {
                // A jet that is stuck open, wholly or in part.
                demand.jet_on_fraction_min[j] = demand.jet_on_fraction_max[j];
            }
        }
        for i in 0..3 {
            let (a, b) = (uniform(&mut rng, -0.5, 0.3), uniform(&mut rng, -0.3, 0.5));
            demand.motor_min[i] = a.min(b);
            demand.motor_max[i] = a.max(b);
        }
        let allocation = allocator.allocate(&demand).unwrap();
        let check = allocator.check(&demand, &allocation).unwrap();
        match allocation.status {
            Status::Solved { .. } => {
                solved += 1;
                assert!(check.agrees(), "{check:?} {allocation:?}");
            }
            Status::Fallback(FallbackReason::BoundsExcludeDemand) => {
                excluded += 1;
                assert!(check.alpha_max.is_none());
            }
            status => panic!("{status:?}"),
        }
    }
    assert!(solved > 500 && excluded > 100, "{solved} {excluded}");
}

#[test]
fn wheels_and_jets_share_at_the_optimum() {
    // Lagrangian: gas + weight/2 sum ((w - desired)/limit)^2 + m'(B u - G w - tau). With no wheel at a
    // bound its own condition gives m in closed form (the axes are x, y, z), and the jets' gradients
    // c + b'm must then be >= 0 where shut, 0 between, <= 0 where open. The small curvature shifts
    // them by about 2e-4.
    let effectors = canted_pods(three_wheels());
    let layout = effectors.layout();
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut rng = Pcg64::new(5, 7);
    let most = layout.jet_gas_rate_kg_s.iter().copied().fold(0.0, f64::max);
    let mut firing = [0; 3];
    for _ in 0..1000 {
        let torque = direction(&mut rng) * uniform(&mut rng, 0.0, 0.5);
        let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, torque);
        demand.motor_min = vec![-100.0; 3];
        demand.motor_max = vec![100.0; 3];
        demand.motor_weight = 10.0_f64.powf(uniform(&mut rng, -1.0, 3.0));
        for desired in &mut demand.motor_desired {
            *desired = uniform(&mut rng, -0.2, 0.2);
        }
        let allocation = allocator.allocate(&demand).unwrap();
        assert!(matches!(allocation.status, Status::Solved { .. }), "{allocation:?}");
        assert!(allocation.unallocated_torque_b_n_m.norm() < 1e-9, "{allocation:?}");
        let multiplier = Vector3::from_fn(|i, _| {
            let miss = allocation.motor_command[i] - demand.motor_desired[i];
            demand.motor_weight * miss / layout.motor_limit[i].powi(2)
        });
        let missed: f64 = allocation.motor_command.iter().map(|w| w.abs()).sum();
        let tolerance = 4e-4 * (1.0 + missed);
        for (j, &u) in allocation.jet_on_fraction.iter().enumerate() {
            let gradient =
                layout.jet_gas_rate_kg_s[j] / most + layout.jet_torque_b_n_m.column(j).dot(&multiplier);
            let case = if u < 1e-9 {
                0
            } else if u > 1.0 - 1e-9 {
                2
            } else {
                1
            };
            firing[case] += 1;
            match case {
                0 => assert!(gradient > -tolerance, "{j} {u} {gradient} {allocation:?}"),
                1 => assert!(gradient.abs() < tolerance, "{j} {u} {gradient} {allocation:?}"),
                _ => assert!(gradient < tolerance, "{j} {u} {gradient} {allocation:?}"),
            }
        }
    }
    assert!(firing.iter().all(|&count| count > 100), "{firing:?}");
}

#[test]
fn wheels_follow_their_desired_torque_when_it_is_dear_and_jets_make_up() {
    let effectors = canted_pods(three_wheels());
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, Vector3::new(0.05, 0.0, 0.02));
    let desired = [0.03, -0.05, 0.04];
    demand.motor_desired = desired.to_vec();
    demand.motor_weight = 1e5;
    let expensive = allocator.allocate(&demand).unwrap();
    for (w, d) in expensive.motor_command.iter().zip(desired) {
        assert!((w - d).abs() < 1e-3, "{expensive:?}");
    }
    assert!(expensive.gas_rate_kg_s > 0.0 && expensive.unallocated_torque_b_n_m.norm() < 1e-9);
    demand.motor_weight = 0.0;
    let free = allocator.allocate(&demand).unwrap();
    assert_eq!(free.gas_rate_kg_s, 0.0, "wheels can do it all: {free:?}");
    // A motor that spins its wheel up about +x turns the body about -x.
    assert!((free.motor_command[0] + 0.05).abs() < 1e-9, "{free:?}");
}

#[test]
fn three_wheels_are_unique_and_the_program_agrees() {
    let skew = [Vector3::new(1.0, 0.1, 0.0), Vector3::new(-0.2, 1.0, 0.3), Vector3::new(0.1, 0.2, 1.0)];
    let effectors = wheels_only(&skew, 0.2);
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let inverse = Matrix3::from_columns(&skew.map(|axis| -axis / axis.norm())).try_inverse().unwrap();
    let mut rng = Pcg64::new(6, 7);
    for case in 0..500 {
        let torque = direction(&mut rng) * uniform(&mut rng, 0.0, 0.6);
        let mut demand = TorqueDemand::nominal(&effectors, Mode::Motors, torque);
        if case % 2 == 1 {
            demand.motor_max[case % 3] = 0.03;
            demand.motor_min[case % 3] = -0.01;
        }
        let closed = allocator.allocate(&demand).unwrap();
        assert_eq!(closed.status, Status::ClosedForm);
        // By hand: the wheel that runs out first sets alpha.
        let unlimited = inverse * torque;
        let mut alpha = 1.0_f64;
        for (i, &w) in unlimited.iter().enumerate() {
            let most = demand.motor_max[i];
            let least = demand.motor_min[i];
            alpha = alpha.min(if w > 0.0 { most / w } else { least / w });
        }
        assert!((closed.alpha - alpha).abs() < 1e-9, "{} {alpha}", closed.alpha);
        for (w, expected) in closed.motor_command.iter().zip((unlimited * alpha).iter()) {
            assert!((w - expected).abs() < 1e-9);
        }
        let program = allocator.allocate_by_program(&demand).unwrap();
        assert!(matches!(program.status, Status::Solved { .. }), "{program:?}");
        let difference = closed.achieved_torque_b_n_m - program.achieved_torque_b_n_m;
        assert!(difference.norm() < 1e-8, "{closed:?} {program:?}");
    }
}

#[test]
fn four_wheels_share_with_least_effort() {
    // A pyramid: the minimum-norm solution is the pseudo-inverse while no wheel saturates.
    let axes = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| Vector3::new(x, y, 1.0));
    let effectors = wheels_only(&axes, 0.2);
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let columns = effectors.layout().motor_torque_b.clone();
    let inverse = columns.pseudo_inverse(1e-9).unwrap();
    let torque = Vector3::new(0.05, -0.08, 0.11);
    let demand = TorqueDemand::nominal(&effectors, Mode::Both, torque);
    let allocation = allocator.allocate(&demand).unwrap();
    for (w, expected) in allocation.motor_command.iter().zip((inverse * torque).iter()) {
        assert!((w - expected).abs() < 1e-7, "{allocation:?}");
    }
}

#[test]
fn net_force_falls_when_it_is_priced_and_the_torque_stays() {
    let effectors = canted_pods(no_wheels());
    let force = effectors.layout().jet_force_b_n.clone().unwrap();
    let mut allocator = Allocator::new(effectors.clone()).unwrap();
    let mut demand = TorqueDemand::nominal(&effectors, Mode::Jets, Vector3::new(0.1, 0.05, -0.08));
    let plain = allocator.allocate(&demand).unwrap();
    demand.net_force_weight = 100.0;
    let priced = allocator.allocate(&demand).unwrap();
    let norm = |u: &[f64]| (&force * nalgebra::DVector::from_column_slice(u)).norm();
    assert!(norm(&priced.jet_on_fraction) < 0.2 * norm(&plain.jet_on_fraction), "{priced:?}");
    assert!(priced.unallocated_torque_b_n_m.norm() < 1e-6 * 0.25, "{priced:?}");
    assert!(priced.gas_rate_kg_s > plain.gas_rate_kg_s);
    demand.torque_b_n_m *= 20.0;
    let far = allocator.allocate(&demand).unwrap();
    let check = allocator.check(&demand, &far).unwrap();
    let given = far.achieved_torque_b_n_m.dot(&demand.torque_b_n_m) / demand.torque_b_n_m.norm_squared();
    assert!((given - largest_share(&effectors, &demand)).abs() < 1e-5, "{given}");
    assert!(check.torque_error < 1e-6, "{check:?}");
}

#[test]
fn answers_do_not_depend_on_earlier_calls() {
    let effectors = canted_pods(three_wheels());
    let mut used = Allocator::new(effectors.clone()).unwrap();
    let mut rng = Pcg64::new(8, 7);
    for _ in 0..20 {
        let torque = direction(&mut rng) * uniform(&mut rng, 0.0, 2.0);
        let mut demand = TorqueDemand::nominal(&effectors, Mode::Both, torque);
        demand.motor_weight = uniform(&mut rng, 0.0, 5.0);
        demand.jet_available = JetMask(0xffff_ffff).without((uniform(&mut rng, 0.0, 12.0)) as usize);
        let mut fresh = Allocator::new(effectors.clone()).unwrap();
        assert_eq!(used.allocate(&demand).unwrap(), fresh.allocate(&demand).unwrap());
    }
}

#[test]
fn least_cost_is_no_more_than_any_admissible_allocation() {
    // Independent of every solver: random admissible on-times define the torque.
    let effectors = canted_pods(no_wheels());
    let generators: Vec<_> = (0..12).map(|j| effectors.column(j)).collect();
    let cost = vec![1.0; 12];
    let table = LeastCost::new(&generators, Vector3::zeros(), &cost);
    let mut rng = Pcg64::new(9, 7);
    for _ in 0..500 {
        let u: Vec<f64> = (0..12).map(|_| uniform(&mut rng, 0.0, 1.0)).collect();
        let torque = effectors.torque_b_n_m(&u, &[]);
        let least = table.of(&torque);
        assert!(least > 0.0 && least <= u.iter().sum::<f64>() + 1e-9);
    }
}

#[test]
fn random_layouts_are_solved_exactly_or_say_why() {
    // Any number of jets and wheels, parallel, coplanar, dead and tiny ones, narrow and one-sided
    // bounds, sizes over many decades: nothing panics, nothing leaves its bounds, what is called
    // solved agrees with the oracle.
    let mut rng = Pcg64::new(10, 7);
    let mut counts = [0; 3];
    for case in 0..1200 {
        let jets = 1 + (case * 7) % 32;
        let wheels = (case * 5) % 9;
        let size = 10.0_f64.powf(uniform(&mut rng, -4.0, 4.0));
        let flat = case % 10 == 3;
        let mut axes: Vec<Vector3<f64>> = vec![];
        let mut columns: Vec<Vector3<f64>> = vec![];
        for j in 0..jets {
            let mut b = direction(&mut rng) * (size * uniform(&mut rng, 0.3, 1.0));
            match (uniform(&mut rng, 0.0, 10.0)) as usize {
                0 => b *= 0.0,
                1 => b *= 1e-3,
                2 | 3 if j > 0 => b = -columns[j - 1],
                4 if j > 1 => b = columns[j - 1] - columns[j - 2] * 0.5,
                _ => {}
            }
            if flat {
                b.z = 0.0;
            }
            columns.push(b);
        }
        for _ in 0..wheels {
            axes.push(direction(&mut rng));
        }
        let effectors = Effectors::new(EffectorLayout {
            jet_torque_b_n_m: Matrix3xX::from_columns(&columns),
            jet_force_b_n: None,
            jet_gas_rate_kg_s: (0..jets).map(|_| uniform(&mut rng, 0.2, 1.0)).collect(),
            motor_torque_b: Matrix3xX::from_fn(wheels, |i, k| -axes[k][i]),
            motor_limit: vec![size * 10.0_f64.powf(uniform(&mut rng, -2.0, 0.5)); wheels],
        })
        .unwrap();
        let mut allocator = Allocator::new(effectors.clone()).unwrap();
        for mode in [Mode::Jets, Mode::Both, Mode::Motors] {
            let mut torque = direction(&mut rng) * (size * 10.0_f64.powf(uniform(&mut rng, -3.0, 1.5)));
            if flat {
                torque.z = 0.0;
            }
            let mut demand = TorqueDemand::nominal(&effectors, mode, torque);
            demand.jet_available = JetMask(rng.next_u32() | rng.next_u32());
            demand.motor_weight = 10.0_f64.powf(uniform(&mut rng, -3.0, 3.0));
            for j in 0..jets {
                if uniform(&mut rng, 0.0, 1.0) < 0.2 {
                    demand.jet_on_fraction_max[j] = uniform(&mut rng, 0.0, 1.0);
                    demand.jet_on_fraction_min[j] =
                        demand.jet_on_fraction_max[j] * if case % 3 == 0 { 0.999_999 } else { 0.0 };
                }
            }
            let allocation = allocator.allocate(&demand).unwrap();
            let check = allocator.check(&demand, &allocation).unwrap();
            assert!(check.bound_violation <= 0.0, "{check:?}");
            assert!(allocation.achieved_torque_b_n_m.iter().all(|t| t.is_finite()));
            match allocation.status {
                Status::Solved { .. } => {
                    counts[0] += 1;
                    assert!(check.agrees(), "{case} {mode:?} {check:?}\n{allocation:?}\n{demand:?}");
                }
                Status::ClosedForm => {
                    counts[1] += 1;
                    assert!(check.agrees(), "{case} {mode:?} {check:?}\n{allocation:?}\n{demand:?}");
                }
                Status::Fallback(reason) => {
                    counts[2] += 1;
                    assert!(
                        !matches!(reason, FallbackReason::NotSolved(_)),
                        "{case} {mode:?} {allocation:?}\n{demand:?}"
                    );
                    // Never worse than doing nothing, unless the bounds exclude that.
                    if case % 3 != 0 {
                        let left = allocation.unallocated_torque_b_n_m.norm();
                        assert!(left <= torque.norm() * (1.0 + 1e-6), "{allocation:?}");
                    }
                }
            }
        }
    }
    println!("solved, closed form, fallback: {counts:?}");
    assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
}
