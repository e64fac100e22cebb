//! Attitude from two directions (TRIAD).
//!
//! H. D. Black, "A passive system for determining the attitude of a satellite",
//! AIAA Journal 2(7), 1964.

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};
use std::fmt;

/// Sine of the angle between the two directions below which they count as parallel.
const MIN_SINE: f64 = 1e-6;

/// The two directions are parallel, so the rotation about them is not determined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoVectorError {
    /// Sine of the smaller of the two angles (body pair, world pair).
    pub sine: f64,
}

impl fmt::Display for TwoVectorError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "the two directions are parallel (sine of their angle {:.2e}, at least {MIN_SINE:.0e} \
             needed): they do not determine an attitude",
            self.sine
        )
    }
}

impl std::error::Error for TwoVectorError {}

/// `q_world_body` from two directions known in both frames.
///
/// The primary pair is matched exactly; the secondary pair only fixes the rotation about it.
///
/// # Errors
/// [`TwoVectorError`] if either pair is parallel (or not finite).
pub fn attitude_from_two_vectors(
    primary_b: &Unit<Vector3<f64>>,
    primary_w: &Unit<Vector3<f64>>,
    secondary_b: &Unit<Vector3<f64>>,
    secondary_w: &Unit<Vector3<f64>>,
) -> Result<UnitQuaternion<f64>, TwoVectorError> {
    let body = triad(primary_b, secondary_b)?;
    let world = triad(primary_w, secondary_w)?;
    let rotation = Rotation3::from_matrix_unchecked(world * body.transpose());
    Ok(UnitQuaternion::from_rotation_matrix(&rotation))
}

/// Orthonormal axes: the primary, the common normal, and their cross product.
fn triad(
    primary: &Unit<Vector3<f64>>,
    secondary: &Unit<Vector3<f64>>,
) -> Result<Matrix3<f64>, TwoVectorError> {
    let cross = primary.cross(secondary);
    let sine = cross.norm();
    if sine.is_nan() || sine < MIN_SINE {
        return Err(TwoVectorError { sine });
    }
    let normal = cross / sine;
    let third = primary.cross(&normal);
    Ok(Matrix3::from_columns(&[primary.into_inner(), normal, third]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{quaternion_exp, unit};
    use proptest::prelude::*;

    #[test]
    fn parallel_directions_are_refused() {
        let (x, z) = (Vector3::x_axis(), Vector3::z_axis());
        assert!(attitude_from_two_vectors(&z, &z, &z, &x).is_err());
        assert!(attitude_from_two_vectors(&z, &z, &x, &-z).is_err());
        let nan = Unit::new_unchecked(Vector3::repeat(f64::NAN));
        assert!(attitude_from_two_vectors(&z, &z, &nan, &x).is_err());
    }

    #[test]
    fn primary_is_matched_when_the_pairs_disagree() {
        let secondary_b = unit(Vector3::new(1.0, 0.0, 0.3)).expect("unit");
        let (x, z) = (Vector3::x_axis(), Vector3::z_axis());
        let q = attitude_from_two_vectors(&z, &z, &secondary_b, &x).expect("not parallel");
        assert!(q.angle() < 1e-14);
    }

    proptest! {
        #[test]
        fn exact_directions_give_the_exact_attitude(
            v in prop::array::uniform3(-1.8..1.8_f64),
            a in prop::array::uniform3(-1.0..1.0_f64),
            b in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let (a, b) = (Vector3::from(a), Vector3::from(b));
            prop_assume!(a.norm() > 0.1 && b.norm() > 0.1 && a.cross(&b).norm() > 0.01);
            let (a, b) = (unit(a).expect("long"), unit(b).expect("long"));
            let truth = quaternion_exp(&Vector3::from(v));
            let q = attitude_from_two_vectors(&(truth.inverse() * a), &a, &(truth.inverse() * b), &b);
            prop_assert!(q.expect("not parallel").angle_to(&truth) < 1e-6);
        }
    }
}
