//! The oracle against closed forms and brute force.

use nalgebra::Vector3;
use rand_pcg::Pcg64;

use crate::layouts::{direction, uniform};
use crate::zonotope::{LeastCost, Zonotope};

#[test]
fn a_cube_is_a_cube() {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * 2.0);
    let cube = Zonotope::new(&axes, Vector3::repeat(-1.0));
    assert!((cube.alpha_max(&Vector3::new(4.0, 0.0, 0.0)).unwrap() - 0.25).abs() < 1e-12);
    assert!((cube.alpha_max(&Vector3::new(2.0, -1.0, 1.0)).unwrap() - 0.5).abs() < 1e-12);
    assert_eq!(cube.alpha_max(&Vector3::new(0.5, 0.5, 0.5)).unwrap(), 1.0);
}

#[test]
fn a_rhombic_dodecahedron_has_its_printed_faces() {
    // The zonotope of the four cube diagonals; faces x +- y = const, inradius sqrt(2) for edges (1,1,1).
    let diagonals = [(1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (1.0, -1.0, 1.0), (-1.0, 1.0, 1.0)]
        .map(|(x, y, z)| Vector3::new(x, y, z));
    let centre = diagonals.iter().sum::<Vector3<f64>>() / 2.0;
    let body = Zonotope::new(&diagonals, -centre);
    let reach = |direction: Vector3<f64>| 100.0 * body.alpha_max(&(direction * 100.0)).unwrap();
    // Vertices of degree four at distance 2 along the axes, of degree three at (1,1,1), face
    // centres at (1,1,0).
    assert!((reach(Vector3::x()) - 2.0).abs() < 1e-9);
    assert!((reach(Vector3::new(1.0, 1.0, 1.0)) - 1.0).abs() < 1e-9);
    assert!((reach(Vector3::new(1.0, 1.0, 0.0)) - 1.0).abs() < 1e-9);
}

#[test]
fn flat_and_thin_sets_are_exact() {
    let plane = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(1.0, 1.0, 0.0), Vector3::new(0.0, 2.0, 0.0)];
    let flat = Zonotope::new(&plane, Vector3::zeros());
    // Support along x: 2; along (1,0)+(1,1) corner (2,1).
    assert!((flat.alpha_max(&Vector3::new(4.0, 2.0, 0.0)).unwrap() - 0.5).abs() < 1e-12);
    assert!(flat.alpha_max(&Vector3::new(4.0, 2.0, 0.5)).unwrap() < 1e-12);
    let line = [Vector3::new(0.0, 0.0, 1.5), Vector3::new(0.0, 0.0, -0.5), Vector3::zeros()];
    let thin = Zonotope::new(&line, Vector3::zeros());
    assert!((thin.alpha_max(&Vector3::new(0.0, 0.0, 3.0)).unwrap() - 0.5).abs() < 1e-12);
    assert!((thin.alpha_max(&Vector3::new(0.0, 0.0, -1.0)).unwrap() - 0.5).abs() < 1e-12);
    assert!(thin.alpha_max(&Vector3::new(0.1, 0.0, 0.0)).unwrap() < 1e-12);
    let point = Zonotope::new(&[], Vector3::zeros());
    assert_eq!(point.alpha_max(&Vector3::x()).unwrap(), 0.0);
    assert_eq!(point.alpha_max(&Vector3::zeros()).unwrap(), 1.0);
    let shifted = Zonotope::new(&[], Vector3::x());
    assert_eq!(shifted.alpha_max(&Vector3::y()), None);
    assert!((shifted.alpha_max(&Vector3::new(2.0, 0.0, 0.0)).unwrap() - 0.5).abs() < 1e-12);
}

#[test]
fn boundary_points_by_maximisation_are_boundary_points_by_facets() {
    // For any direction n the farthest point is sum of the a_k with n'a_k > 0: alpha_max is 1 there,
    // and less just beyond.
    let mut rng = Pcg64::new(21, 7);
    for count in 3..9 {
        let generators: Vec<_> =
            (0..count).map(|_| direction(&mut rng) * uniform(&mut rng, 0.1, 2.0)).collect();
        let set = Zonotope::new(&generators, Vector3::zeros());
        for _ in 0..50 {
            let normal = direction(&mut rng);
            let far: Vector3<f64> = generators.iter().filter(|a| normal.dot(a) > 0.0).sum();
            assert!(set.alpha_max(&far).unwrap() > 1.0 - 1e-9);
            let beyond = far + normal * 1e-3;
            assert!(set.alpha_max(&beyond).unwrap() < 1.0);
        }
    }
}

/// Least cost by enumeration of basic solutions: every choice of three basic variables, all others at
/// either bound. Exact and slow.
fn brute_force(generators: &[Vector3<f64>], cost: &[f64], torque: Vector3<f64>) -> f64 {
    let n = generators.len();
    let mut best = f64::INFINITY;
    for i in 0..n {
        for j in i + 1..n {
            for k in j + 1..n {
                let basis = nalgebra::Matrix3::from_columns(&[generators[i], generators[j], generators[k]]);
                let Some(inverse) = basis.try_inverse() else { continue };
                for pattern in 0..1_u32 << n {
                    if pattern & (1 << i | 1 << j | 1 << k) != 0 {
                        continue;
                    }
                    let (mut rest, mut total) = (torque, 0.0);
                    for m in (0..n).filter(|m| pattern >> m & 1 == 1) {
                        rest -= generators[m];
                        total += cost[m];
                    }
                    let x = inverse * rest;
                    if x.iter().all(|&x| (-1e-9..=1.0 + 1e-9).contains(&x)) {
                        best = best.min(total + cost[i] * x[0] + cost[j] * x[1] + cost[k] * x[2]);
                    }
                }
            }
        }
    }
    best
}

#[test]
fn least_cost_is_the_best_basic_solution() {
    let mut rng = Pcg64::new(22, 7);
    for _ in 0..20 {
        let generators: Vec<_> = (0..7).map(|_| direction(&mut rng)).collect();
        let cost: Vec<f64> = (0..7).map(|_| uniform(&mut rng, 0.0, 2.0)).collect();
        let torque: Vector3<f64> = generators.iter().map(|a| a * uniform(&mut rng, 0.0, 1.0)).sum();
        let exact = brute_force(&generators, &cost, torque);
        let least = LeastCost::new(&generators, Vector3::zeros(), &cost).of(&torque);
        assert!((least - exact).abs() < 1e-9, "{least} {exact}");
    }
}

#[test]
fn least_cost_in_a_plane_and_on_a_line() {
    // Two cheap generators at right angles and an expensive diagonal one: the diagonal pays below cost 2.
    let plane = [Vector3::x(), Vector3::y(), Vector3::new(1.0, 1.0, 0.0)];
    let cheap = LeastCost::new(&plane, Vector3::zeros(), &[1.0, 1.0, 1.5]);
    assert!((cheap.of(&Vector3::new(0.5, 0.7, 0.0)) - (0.5 * 1.5 + 0.2)).abs() < 1e-12);
    let dear = LeastCost::new(&plane, Vector3::zeros(), &[1.0, 1.0, 2.5]);
    assert!((dear.of(&Vector3::new(0.5, 0.7, 0.0)) - 1.2).abs() < 1e-12);
    let line = [Vector3::z(), Vector3::z() * -1.0, Vector3::z()];
    let thin = LeastCost::new(&line, Vector3::zeros(), &[1.0, 1.0, 3.0]);
    assert!((thin.of(&Vector3::new(0.0, 0.0, 1.5)) - 2.5).abs() < 1e-12);
    assert!((thin.of(&Vector3::new(0.0, 0.0, -0.5)) - 0.5).abs() < 1e-12);
}
