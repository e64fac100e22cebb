//! Inertias that a rigid body can have.
//!
//! A body with density rho about a point has the second moments of mass S = int rho r r^T dV >= 0, and
//! I = tr(S) 1 - S, so that S = tr(I)/2 1 - I. "Positive semidefinite S" is the whole condition: it holds
//! exactly when the principal moments are positive and obey the triangle inequalities. With the first
//! moment c and the mass m it is the upper left block of the pseudo-inertia [[S, c], [c^T, m]] >= 0
//! (P. M. Wensing, S. Kim, J.-J. E. Slotine, IEEE RA-L 3(1), 2018); given the mass the full matrix is
//! constrained by its Schur complement S - c c^T / m >= 0.
//!
//! The nearest such inertia in the metric of the fit's information is a small semidefinite program. It
//! is solved here by a logarithmic barrier and Newton's method. Clarabel's semidefinite cone would do it
//! as well, but needs a LAPACK from outside the build; for one 3 x 3 matrix that is a poor trade.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector, inertia_b_kg_m2};

/// The smallest principal second moment of mass [kg m^2]: negative for an impossible inertia.
#[must_use]
pub fn smallest_density_moment_kg_m2(inertia: &Matrix3<f64>) -> f64 {
    SymmetricEigen::new(second_moment(inertia)).eigenvalues.min()
}

/// S = tr(I)/2 1 - I.
fn second_moment(inertia: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * (0.5 * inertia.trace()) - inertia
}

/// dS/dp for each of the six inertia parameters.
fn directions() -> [Matrix3<f64>; 6] {
    std::array::from_fn(|n| {
        let mut unit = MassVector::zeros();
        unit[n] = 1.0;
        second_moment(&inertia_b_kg_m2(&unit))
    })
}

/// The realisable parameters that minimise (p - found)^T P^-1 (p - found): with the fit's covariance P
/// this is the constrained estimate itself, because the fit's cost is quadratic there.
///
/// The result is inside by a share of 1e-7 of the trace, so that it can be used; parameters that are
/// already realisable come back unchanged. A covariance that is not positive definite counts as unity.
#[must_use]
pub fn nearest_realisable(found: &MassVector, covariance: &MassCovariance) -> MassVector {
    if smallest_density_moment_kg_m2(&inertia_b_kg_m2(found)) > 0.0 {
        return *found;
    }
    let information = covariance.cholesky().map_or_else(MassCovariance::identity, |f| f.inverse());
    let directions = directions();
    let trace = inertia_b_kg_m2(found).trace().abs().max(1e-9);
    let mut point = feasible(found);
    // The barrier's weight falls until it matters less than a millionth of a standard deviation.
    let mut weight = 1.0;
    while weight > 1e-9 {
        for _ in 0..50 {
            let Some((gradient, hessian, value)) = barrier(&point, found, &information, &directions, weight)
            else {
                break;
            };
            let Some(factor) = hessian.cholesky() else { break };
            let step = -factor.solve(&gradient);
            let decrement = -gradient.dot(&step);
            let mut share = 1.0;
            while share > 1e-12 {
                let moved = point + step * share;
                let better = barrier(&moved, found, &information, &directions, weight)
                    .is_some_and(|(_, _, v)| v <= value - 0.1 * share * decrement);
                if better {
                    point = moved;
                    break;
                }
                share *= 0.5;
            }
            if decrement < 1e-12 || share <= 1e-12 {
                break;
            }
        }
        weight *= 0.2;
    }
    debug_assert!(smallest_density_moment_kg_m2(&inertia_b_kg_m2(&point)) > -1e-9 * trace);
    point
}

/// A point inside: the eigenvalues of S lifted to a small positive value.
fn feasible(found: &MassVector) -> MassVector {
    let eigen = SymmetricEigen::new(second_moment(&inertia_b_kg_m2(found)));
    let floor = 0.01 * eigen.eigenvalues.amax().max(1e-6);
    let lifted: Vector3<f64> = eigen.eigenvalues.map(|x| x.max(floor));
    let s = eigen.eigenvectors * Matrix3::from_diagonal(&lifted) * eigen.eigenvectors.transpose();
    let inertia = Matrix3::identity() * s.trace() - s;
    let mut point = *found;
    let elements = [inertia.m11, inertia.m12, inertia.m13, inertia.m22, inertia.m23, inertia.m33];
    for (slot, value) in point.iter_mut().zip(elements) {
        *slot = value;
    }
    point
}

/// Gradient, Hessian and value of 1/2 d^T L d - weight log det S; `None` outside.
fn barrier(
    point: &MassVector,
    found: &MassVector,
    information: &MassCovariance,
    directions: &[Matrix3<f64>; 6],
    weight: f64,
) -> Option<(MassVector, MassCovariance, f64)> {
    let factor = second_moment(&inertia_b_kg_m2(point)).cholesky()?;
    let log_determinant = 2.0 * factor.l().diagonal().map(f64::ln).sum();
    let inverse = factor.inverse();
    let difference = point - found;
    let mut gradient = information * difference;
    let mut hessian = *information;
    for (i, a) in directions.iter().enumerate() {
        let left = inverse * a;
        gradient[i] -= weight * left.trace();
        for (j, b) in directions.iter().enumerate() {
            hessian[(i, j)] += weight * (left * inverse * b).trace();
        }
    }
    debug_assert_eq!(gradient.len(), MASS_PARAMETERS);
    let value = 0.5 * difference.dot(&(information * difference)) - weight * log_determinant;
    value.is_finite().then_some((gradient, hessian, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Impossible: I_zz = 14.5 > 6.2 + 7.5.
    fn impossible() -> MassVector {
        MassVector::from([6.2, 0.0, 0.0, 7.5, 0.0, 14.5, -0.02, -0.07, -2.0])
    }

    /// With unit metric and a diagonal inertia the nearest point on I_zz = I_xx + I_yy is the orthogonal
    /// projection: an excess of 0.8 is shared in the ratio 1 : 1 : -1, 0.8 / 3 each.
    #[test]
    fn nearest_is_the_orthogonal_projection_for_a_diagonal_case() {
        let near = nearest_realisable(&impossible(), &MassCovariance::identity());
        let share = 0.8 / 3.0;
        let expected = [6.2 + share, 0.0, 0.0, 7.5 + share, 0.0, 14.5 - share, -0.02, -0.07, -2.0];
        assert!((near - MassVector::from(expected)).amax() < 1e-6, "{near}");
        assert!(smallest_density_moment_kg_m2(&inertia_b_kg_m2(&near)) > 0.0);
    }

    /// Optimality for a general metric (Karush-Kuhn-Tucker): the pull L (found - p) must be a
    /// combination -tr(Z dS/dp) with Z >= 0 and Z S = 0, so it can lower no realisable direction.
    #[test]
    fn no_realisable_neighbour_is_nearer() {
        let mut found = impossible();
        found[1] = -0.9;
        found[4] = 0.4;
        let mut covariance = MassCovariance::identity() * 0.01;
        covariance[(5, 5)] = 0.2;
        covariance[(0, 5)] = 0.02;
        covariance[(5, 0)] = 0.02;
        covariance[(6, 5)] = 0.01;
        covariance[(5, 6)] = 0.01;
        let near = nearest_realisable(&found, &covariance);
        let information = covariance.try_inverse().unwrap();
        let distance = |p: &MassVector| (p - found).dot(&(information * (p - found)));
        let best = distance(&near);
        let mut tried = 0;
        for n in 0..4000u32 {
            // A quasi-random neighbour.
            let neighbour = MassVector::from_fn(|i, _| {
                near[i] + 0.1 * ((f64::from(n) * (0.754_877 + 0.1 * i as f64)).fract() - 0.5)
            });
            if smallest_density_moment_kg_m2(&inertia_b_kg_m2(&neighbour)) >= 0.0 {
                tried += 1;
                assert!(distance(&neighbour) > best - 1e-6);
            }
        }
        assert!(tried > 100, "{tried}");
        // The gravity offset moved with the inertia that it is correlated with.
        assert!((near[6] - found[6]).abs() > 1e-4);
    }

    #[test]
    fn possible_inertias_stay() {
        let p = MassVector::from([6.2, -0.9, -0.2, 7.5, 0.1, 12.1, -0.02, -0.07, -2.0]);
        assert_eq!(nearest_realisable(&p, &MassCovariance::identity()), p);
    }
}
