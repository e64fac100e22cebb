//! Tilting an axis by two small angles.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_math::unit_or;

/// `axis` turned by the rotation vector a e1 + b e2, where e1 = axis x z (axis x x when the axis is
/// within 45 degrees of z) normalised and e2 = axis x e1. Angles in radians; exact at zero.
pub(super) fn tilted(axis: Unit<Vector3<f64>>, angles_rad: [f64; 2]) -> Unit<Vector3<f64>> {
    if angles_rad == [0.0; 2] { axis } else { tilt(axis, angles_rad) * axis }
}

/// The rotation by which [`tilted`] turns the axis.
pub(super) fn tilt(axis: Unit<Vector3<f64>>, [a_rad, b_rad]: [f64; 2]) -> UnitQuaternion<f64> {
    let helper = if axis.z.abs() > std::f64::consts::FRAC_1_SQRT_2 { Vector3::x() } else { Vector3::z() };
    // The helper is at least 45 degrees away, so the fallback is never taken.
    let e1 = unit_or(axis.cross(&helper), Vector3::x_axis()).into_inner();
    let e2 = axis.cross(&e1);
    UnitQuaternion::from_scaled_axis(e1 * a_rad + e2 * b_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tilts_by_the_given_angle_across_the_axis() {
        for axis in [Vector3::x_axis(), Vector3::z_axis(), Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5))]
        {
            for (a, b) in [(0.03, 0.0), (0.0, -0.02), (0.03, 0.04)] {
                let moved = tilted(axis, [a, b]);
                assert!((moved.dot(&axis).acos() - f64::hypot(a, b)).abs() < 1e-9);
            }
            let first = tilted(axis, [1e-4, 0.0]).into_inner() - axis.into_inner();
            let second = tilted(axis, [0.0, 1e-4]).into_inner() - axis.into_inner();
            assert!(first.dot(&second).abs() < 1e-12, "the two tilts are across each other");
        }
    }
}
