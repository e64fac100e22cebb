//! Vectors: cross-product matrix and checked normalisation.

use nalgebra::{Matrix3, Unit, Vector3};
use std::fmt;

/// Length below which a vector has no usable direction.
const MIN_NORM: f64 = 1e-12;

/// The cross-product matrix: `skew(a) * b = a x b` (the dissertation's superscript `x`).
#[must_use]
#[inline]
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// A vector without a direction: not finite, or shorter than 1e-12 in its own unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DegenerateVector {
    /// The vector that was given.
    pub vector: Vector3<f64>,
}

impl fmt::Display for DegenerateVector {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.vector.into();
        write!(formatter, "[{x}, {y}, {z}] has no direction: it is zero or not finite")
    }
}

impl std::error::Error for DegenerateVector {}

/// The direction of a vector.
///
/// # Errors
/// [`DegenerateVector`] for a vector that is not finite or shorter than 1e-12.
pub fn unit(vector: Vector3<f64>) -> Result<Unit<Vector3<f64>>, DegenerateVector> {
    // Scaling first keeps the squares of huge and tiny components representable.
    let largest = vector.amax();
    if !vector.iter().all(|c| c.is_finite()) || largest < MIN_NORM {
        return Err(DegenerateVector { vector });
    }
    let scaled = vector / largest;
    let norm = scaled.norm();
    if norm * largest < MIN_NORM {
        return Err(DegenerateVector { vector });
    }
    Ok(Unit::new_unchecked(scaled / norm))
}

/// The direction of a vector, or `fallback` when it has none.
#[must_use]
pub fn unit_or(vector: Vector3<f64>, fallback: Unit<Vector3<f64>>) -> Unit<Vector3<f64>> {
    unit(vector).unwrap_or(fallback)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skew_is_the_cross_product() {
        let (a, b) = (Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.5, 4.0, -1.0));
        // By hand: (-2)(-1) - 3*4, 3*0.5 - 1*(-1), 1*4 - (-2)*0.5.
        assert_eq!(skew(&a) * b, Vector3::new(-10.0, 2.5, 5.0));
    }

    #[test]
    fn vectors_without_direction_are_refused() {
        for bad in [
            Vector3::zeros(),
            Vector3::new(f64::NAN, 1.0, 0.0),
            Vector3::new(f64::INFINITY, 0.0, 0.0),
            Vector3::new(1e-13, 0.0, 0.0),
        ] {
            assert!(unit(bad).is_err(), "{bad}");
            assert_eq!(unit_or(bad, Vector3::z_axis()), Vector3::z_axis());
        }
    }

    #[test]
    fn extreme_lengths_still_have_a_direction() {
        let direction = unit(Vector3::new(3e200, 0.0, 4e200)).expect("has a direction");
        assert!((direction.into_inner() - Vector3::new(0.6, 0.0, 0.8)).norm() < 1e-15);
    }
}
