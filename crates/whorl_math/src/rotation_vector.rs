//! Exponential and logarithm of the unit quaternion.

use crate::skew;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Below this squared angle \[rad^2\] the Taylor series is exact to rounding (and faster).
const SMALL_ANGLE_SQUARED: f64 = 1e-4;

/// The rotation by `rotation_rad` (axis times angle), for any angle.
#[must_use]
#[inline]
pub fn quaternion_exp(rotation_rad: &Vector3<f64>) -> UnitQuaternion<f64> {
    let squared = rotation_rad.norm_squared();
    let (scalar, scale) = if squared < SMALL_ANGLE_SQUARED {
        (1.0 - squared / 8.0 * (1.0 - squared / 48.0), 0.5 - squared / 48.0 * (1.0 - squared / 80.0))
    } else {
        let angle = squared.sqrt();
        let (sine, cosine) = (0.5 * angle).sin_cos();
        (cosine, sine / angle)
    };
    UnitQuaternion::new_unchecked(Quaternion::from_parts(scalar, rotation_rad * scale))
}

/// The rotation vector (axis times angle, \[rad\]) of the shortest way, angle in `[0, pi]`.
///
/// At exactly 180 degrees the axis is that of the stored quaternion: both signs are the
/// same rotation.
#[must_use]
#[inline]
pub fn rotation_vector(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let (scalar, vector) = (sign * q.w, sign * q.imag());
    let sine_squared = vector.norm_squared();
    if sine_squared < 1e-8 {
        // 2 asin(s)/s; the scalar part is close to one and holds no information here.
        return vector * (2.0 + sine_squared / 3.0);
    }
    let sine = sine_squared.sqrt();
    vector * (2.0 * sine.atan2(scalar) / sine)
}

/// The right Jacobian of SO(3): `exp(phi + d) = exp(phi) exp(J_r(phi) d)` to first order.
#[must_use]
pub fn right_jacobian(rotation_rad: &Vector3<f64>) -> Matrix3<f64> {
    let squared = rotation_rad.norm_squared();
    let (first, second) = if squared < SMALL_ANGLE_SQUARED {
        (0.5 - squared / 24.0 * (1.0 - squared / 30.0), 1.0 / 6.0 - squared / 120.0 * (1.0 - squared / 42.0))
    } else {
        let angle = squared.sqrt();
        let half_sine = (0.5 * angle).sin();
        (2.0 * half_sine * half_sine / squared, (angle - angle.sin()) / (squared * angle))
    };
    let cross = skew(rotation_rad);
    Matrix3::identity() - cross * first + cross * cross * second
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-limit..limit).prop_map(Vector3::from)
    }

    #[test]
    fn exponential_matches_rodrigues_formula_across_scales() {
        let axis = Vector3::new(2.0, -1.0, 2.0) / 3.0;
        for angle in [0.0, 1e-12, 1e-6, 9.99e-3, 1.001e-2, 0.3, 2.0, PI, 5.0, 40.0_f64] {
            let cross = skew(&axis);
            let expected = Matrix3::identity() + cross * angle.sin() + cross * cross * (1.0 - angle.cos());
            let rotation = quaternion_exp(&(axis * angle)).to_rotation_matrix();
            assert!((rotation.matrix() - expected).amax() < 1e-14, "angle {angle}");
        }
    }

    #[test]
    fn logarithm_of_exactly_half_a_turn() {
        for axis in [Vector3::x(), -Vector3::y(), Vector3::new(0.6, 0.0, -0.8)] {
            let q = UnitQuaternion::new_unchecked(Quaternion::from_parts(0.0, axis));
            assert!((rotation_vector(&q) - axis * PI).norm() < 1e-15);
            let negative_zero = UnitQuaternion::new_unchecked(Quaternion::from_parts(-0.0, axis));
            assert!((rotation_vector(&negative_zero).norm() - PI).abs() < 1e-15);
        }
    }

    #[test]
    fn logarithm_goes_the_short_way() {
        let q = quaternion_exp(&Vector3::new(0.0, 0.0, 1.9 * PI));
        assert!((rotation_vector(&q) - Vector3::new(0.0, 0.0, -0.1 * PI)).norm() < 1e-14);
    }

    proptest! {
        #[test]
        fn logarithm_inverts_the_exponential(v in vector(1.8)) {
            prop_assert!((rotation_vector(&quaternion_exp(&v)) - v).norm() < 1e-13);
        }

        #[test]
        fn logarithm_inverts_tiny_exponentials(v in vector(1.0), exponent in -14.0..-1.0_f64) {
            let tiny = v * 10f64.powf(exponent);
            let error = rotation_vector(&quaternion_exp(&tiny)) - tiny;
            prop_assert!(error.norm() <= 1e-14 * tiny.norm());
        }

        #[test]
        fn exponential_has_unit_norm(v in vector(10.0)) {
            prop_assert!((quaternion_exp(&v).norm() - 1.0).abs() < 1e-15);
        }

        #[test]
        fn right_jacobian_is_the_derivative(v in vector(1.7), d in vector(1.0)) {
            let step = 1e-6;
            let forward = quaternion_exp(&(v + d * step));
            let backward = quaternion_exp(&(v - d * step));
            let numeric = rotation_vector(&(backward.inverse() * forward)) / (2.0 * step);
            prop_assert!((right_jacobian(&v) * d - numeric).norm() < 1e-8);
        }
    }
}
