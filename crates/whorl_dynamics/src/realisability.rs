//! Inertias that a rigid body can have.
//!
//! A body with density rho about a point has the second moments of mass S = int rho r r^T dV >= 0, and
//! I = tr(S) 1 - S, so that S = tr(I)/2 1 - I. "Positive semidefinite S" is the whole condition: it holds
//! exactly when the principal moments are positive and obey the triangle inequalities (P. M. Wensing, S. Kim,
//! J.-J. E. Slotine, IEEE RA-L 3(1), 2018).

use nalgebra::{Matrix3, SymmetricEigen};

/// The smallest principal second moment of mass [kg m^2]: negative for an impossible inertia.
#[must_use]
pub fn smallest_density_moment_kg_m2(inertia: &Matrix3<f64>) -> f64 {
    let second_moment = Matrix3::identity() * (0.5 * inertia.trace()) - inertia;
    SymmetricEigen::new(second_moment).eigenvalues.min()
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    /// A plate is on the edge, whichever way it is turned; half the excess over the triangle inequality is missing beyond.
    #[test]
    fn the_smallest_second_moment_is_half_of_what_the_triangle_inequality_leaves() {
        let r = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.1).to_rotation_matrix().into_inner();
        for (izz, least) in [(13.7, 0.0), (14.5, -0.4), (12.1, 0.8)] {
            let inertia = r * Matrix3::from_diagonal(&Vector3::new(6.2, 7.5, izz)) * r.transpose();
            assert!((smallest_density_moment_kg_m2(&inertia) - least).abs() < 1e-12, "{izz}");
        }
    }
}
