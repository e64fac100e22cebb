//! Directions in which a set of effectors gives no torque.
//!
//! Jets push one way, motors both. What they can give in some amount is the cone `C = { sum u_k tau_k + sum v_m c_m, u_k >= 0 }`. It is all of
//! space unless there is a `w` with `w . tau_k <= 0` for every jet and `w . c_m = 0` for every motor (Farkas' lemma): then no torque
//! has a part along `w`. If the columns span space, the set of such `w` has an edge that is perpendicular to two of
//! them, so that the cross products of all pairs are enough; if not, `w` is perpendicular to all.

use nalgebra::{Matrix3, Vector3};

/// Parts smaller than this are none, relative to the torque \[1\].
const NONE: f64 = 1e-6;

/// A unit direction along which neither `one_way` nor `both_ways` give any torque, body axes; `None` where there is none.
#[must_use]
pub fn missing_torque(one_way: &[Vector3<f64>], both_ways: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let unit = |v: &Vector3<f64>| v.try_normalize(1e-12);
    let jets: Vec<Vector3<f64>> = one_way.iter().filter_map(unit).collect();
    let motors: Vec<Vector3<f64>> = both_ways.iter().filter_map(unit).collect();
    let all: Vec<Vector3<f64>> = jets.iter().chain(&motors).copied().collect();
    let gram: Matrix3<f64> = all.iter().map(|v| v * v.transpose()).sum();
    let eigen = gram.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    if eigen.eigenvalues[least] < NONE * NONE {
        return Some(eigen.eigenvectors.column(least).into_owned());
    }
    let gives_nothing = |w: &Vector3<f64>| {
        jets.iter().all(|tau| w.dot(tau) <= NONE) && motors.iter().all(|c| w.dot(c).abs() <= NONE)
    };
    let pairs = all.iter().enumerate().flat_map(|(n, a)| all.iter().skip(n + 1).map(move |b| a.cross(b)));
    let edges = pairs.filter_map(|w| unit(&w)).flat_map(|w| [w, -w]);
    let mut missing: Vec<Vector3<f64>> = edges.filter(gives_nothing).collect();
    // The middle of the edges is deepest in what is missing.
    let middle = unit(&missing.iter().sum()).filter(gives_nothing);
    middle.or(missing.pop())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64, z: f64) -> Vector3<f64> {
        Vector3::new(x, y, z)
    }

    #[test]
    fn layouts_that_reach_everything_miss_nothing() {
        let six =
            [v(1., 0., 0.), v(-1., 0., 0.), v(0., 1., 0.), v(0., -1., 0.), v(0., 0., 1.), v(0., 0., -1.)];
        assert_eq!(missing_torque(&six, &[]), None);
        // Four jets are the fewest: a tetrahedron.
        let four = [v(1., 1., 1.), v(1., -1., -1.), v(-1., 1., -1.), v(-1., -1., 1.)];
        assert_eq!(missing_torque(&four, &[]), None);
        assert_eq!(missing_torque(&[], &[v(1., 0., 0.), v(0., 1., 0.), v(0., 0.3, 1.)]), None);
        // Jets for one axis, wheels for the others.
        assert_eq!(missing_torque(&six[4..], &[v(1., 0., 0.), v(0., 1., 0.)]), None);
    }

    #[test]
    fn what_is_missing_is_named() {
        let six =
            [v(1., 0., 0.), v(-1., 0., 0.), v(0., 1., 0.), v(0., -1., 0.), v(0., 0., 1.), v(0., 0., -1.)];
        for (left_out, missing) in six.iter().enumerate() {
            let others: Vec<_> =
                six.iter().enumerate().filter(|(n, _)| *n != left_out).map(|(_, v)| *v).collect();
            let found = missing_torque(&others, &[]).unwrap();
            assert!((found - missing).norm() < 1e-9, "{found} {missing}");
        }
        // All in one plane, all in one half, one alone, none.
        assert!(missing_torque(&six[..4], &[]).unwrap().z.abs() > 0.999);
        let half = [v(1., 0., 0.2), v(-1., 0., 0.2), v(0., 1., 0.2), v(0., -1., 0.2)];
        assert!((missing_torque(&half, &[]).unwrap() + Vector3::z()).norm() < 1e-6);
        assert!(missing_torque(&six[..1], &[]).unwrap().x.abs() < 1e-6);
        assert!(missing_torque(&[], &[]).is_some());
        assert!(
            (missing_torque(&six[5..], &[v(1., 0., 0.), v(0., 1., 0.)]).unwrap() - Vector3::z()).norm()
                < 1e-9
        );
    }
}
