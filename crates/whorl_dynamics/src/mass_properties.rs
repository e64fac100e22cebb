//! Inertia about the centre of rotation and the gravity offset.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use thiserror::Error;

/// How far the largest principal moment may exceed the sum of the two others, as a share of that sum. A flat plate has
/// equality, and inertias are rarely known better, so the estimate for a flat platform may lie slightly beyond it.
pub const INERTIA_TOLERANCE: f64 = 0.05;

/// Why mass properties were refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MassPropertiesError {
    /// A value is NaN or infinite.
    #[error("{what} is not finite")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
    },
    /// The matrix is not symmetric.
    #[error("the inertia matrix is not symmetric (largest difference {difference_kg_m2} kg m^2)")]
    NotSymmetric {
        /// Largest |I_ij - I_ji|.
        difference_kg_m2: f64,
    },
    /// An eigenvalue is zero or negative.
    #[error(
        "the inertia matrix is not positive definite (smallest principal moment {smallest_kg_m2} kg m^2)"
    )]
    NotPositiveDefinite {
        /// The smallest principal moment.
        smallest_kg_m2: f64,
    },
    /// The largest principal moment exceeds the sum of the other two by more than [`INERTIA_TOLERANCE`]: no mass
    /// distribution has it.
    #[error(
        "no rigid body has these principal moments {principal_kg_m2:?} kg m^2: the largest exceeds the sum of the other two by more than {:.0} %", 100.0 * INERTIA_TOLERANCE
    )]
    NotRealisable {
        /// Principal moments, ascending.
        principal_kg_m2: [f64; 3],
    },
    /// The mass is not positive.
    #[error("mass {mass_kg} kg is not positive")]
    MassNotPositive {
        /// The refused value.
        mass_kg: f64,
    },
}

/// Mass properties of a platform, wheels at rest included, about the bearing's centre of rotation,
/// in body axes (dissertation eq. 4.73; matrix elements, products of inertia with their sign in
/// the matrix).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassProperties {
    inertia_b_kg_m2: Matrix3<f64>,
    gravity_offset_b_n_m: Vector3<f64>,
    mass_kg: f64,
}

impl MassProperties {
    /// Checked constructor.
    ///
    /// `gravity_offset_b_n_m` is m g r_cg: weight times the centre of mass' position from the
    /// centre of rotation; a negative z component is pendulum-stable.
    ///
    /// # Errors
    /// See [`MassPropertiesError`].
    pub fn new(
        inertia_b_kg_m2: Matrix3<f64>,
        gravity_offset_b_n_m: Vector3<f64>,
        mass_kg: f64,
    ) -> Result<Self, MassPropertiesError> {
        if !inertia_b_kg_m2.iter().all(|x| x.is_finite()) {
            return Err(MassPropertiesError::NotFinite { what: "the inertia matrix" });
        }
        if !gravity_offset_b_n_m.iter().all(|x| x.is_finite()) {
            return Err(MassPropertiesError::NotFinite { what: "the gravity offset m g r_cg" });
        }
        if !(mass_kg > 0.0 && mass_kg.is_finite()) {
            return Err(MassPropertiesError::MassNotPositive { mass_kg });
        }
        let difference_kg_m2 = (inertia_b_kg_m2 - inertia_b_kg_m2.transpose()).amax();
        if difference_kg_m2 > 1e-9 * inertia_b_kg_m2.amax() {
            return Err(MassPropertiesError::NotSymmetric { difference_kg_m2 });
        }
        let mut principal_kg_m2: [f64; 3] = SymmetricEigen::new(inertia_b_kg_m2).eigenvalues.into();
        principal_kg_m2.sort_by(f64::total_cmp);
        let [smallest, middle, largest] = principal_kg_m2;
        if smallest <= 0.0 {
            return Err(MassPropertiesError::NotPositiveDefinite { smallest_kg_m2: smallest });
        }
        if largest > (smallest + middle) * (1.0 + INERTIA_TOLERANCE) {
            return Err(MassPropertiesError::NotRealisable { principal_kg_m2 });
        }
        Ok(Self { inertia_b_kg_m2, gravity_offset_b_n_m, mass_kg })
    }

    /// Inertia matrix about the centre of rotation, body axes.
    #[must_use]
    pub fn inertia_b_kg_m2(&self) -> &Matrix3<f64> {
        &self.inertia_b_kg_m2
    }

    /// m g r_cg in body axes.
    #[must_use]
    pub fn gravity_offset_b_n_m(&self) -> &Vector3<f64> {
        &self.gravity_offset_b_n_m
    }

    /// Mass of the rotating part.
    #[must_use]
    pub fn mass_kg(&self) -> f64 {
        self.mass_kg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagonal(x: f64, y: f64, z: f64) -> Result<MassProperties, MassPropertiesError> {
        MassProperties::new(Matrix3::from_diagonal(&Vector3::new(x, y, z)), Vector3::zeros(), 50.0)
    }

    #[test]
    fn refuses_what_no_rigid_body_has() {
        assert!(diagonal(6.2, 7.5, 12.1).is_ok());
        assert!(diagonal(1.0, 1.0, 2.0).is_ok(), "a flat plate");
        assert!(diagonal(1.0, 1.0, 2.08).is_ok(), "a flat plate, measured");
        assert!(matches!(diagonal(1.0, 1.0, 2.15), Err(MassPropertiesError::NotRealisable { .. })));
        assert!(matches!(diagonal(-1.0, 1.0, 1.0), Err(MassPropertiesError::NotPositiveDefinite { .. })));
        assert!(matches!(diagonal(f64::NAN, 1.0, 1.0), Err(MassPropertiesError::NotFinite { .. })));
        let skewed = Matrix3::new(6.0, 0.5, 0.0, -0.5, 7.0, 0.0, 0.0, 0.0, 12.0);
        assert!(matches!(
            MassProperties::new(skewed, Vector3::zeros(), 50.0),
            Err(MassPropertiesError::NotSymmetric { .. })
        ));
    }
}
