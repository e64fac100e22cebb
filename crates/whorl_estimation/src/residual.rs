//! Innovations of direction measurements.

use nalgebra::{Matrix3x2, Unit, Vector2, Vector3};
use std::f64::consts::PI;
use whorl_math::wrap_angle_rad;

/// Two unit vectors across a direction, as columns.
pub(crate) fn across(direction: &Unit<Vector3<f64>>) -> Matrix3x2<f64> {
    // Start from the axis least along the direction.
    let axis = match direction.iamin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let first = direction.cross(&axis);
    // The cross product with the least aligned axis is never shorter than sqrt(2/3).
    let first = first / first.norm();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}

/// The rotation \[rad\] that takes the measured direction to its reference the shortest way:
/// the attitude error across the direction, valid for any angle.
pub(crate) fn direction_residual(
    measured_w: &Vector3<f64>,
    reference_w: &Unit<Vector3<f64>>,
) -> Vector3<f64> {
    let cross = measured_w.cross(reference_w);
    let sine_squared = cross.norm_squared();
    let cosine = measured_w.dot(reference_w);
    if cosine > 0.0 && sine_squared < 1e-4 {
        // asin(s)/s to rounding.
        return cross * (1.0 + sine_squared * (1.0 / 6.0 + sine_squared * 0.075));
    }
    let sine = sine_squared.sqrt();
    if sine < 1e-9 {
        // Exactly opposite: every way is equally short, so any will do.
        return across(reference_w).column(0) * PI;
    }
    cross * (sine.atan2(cosine) / sine)
}

/// Azimuth error of a measured direction \[rad\] and its sensitivity to the attitude error; the
/// azimuth is exact for any heading error.
pub(crate) fn heading_residual(
    measured_w: &Vector3<f64>,
    reference_w: &Unit<Vector3<f64>>,
) -> (f64, Vector3<f64>) {
    let azimuth = reference_w.y.atan2(reference_w.x);
    let residual = wrap_angle_rad(azimuth - measured_w.y.atan2(measured_w.x));
    let slope = reference_w.z / reference_w.x.hypot(reference_w.y);
    let (sine, cosine) = azimuth.sin_cos();
    (residual, Vector3::new(-slope * cosine, -slope * sine, 1.0))
}

/// Components of a vector along two columns.
pub(crate) fn components(columns: &Matrix3x2<f64>, vector: &Vector3<f64>) -> Vector2<f64> {
    columns.tr_mul(vector)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::{quaternion_exp, unit};

    fn direction(x: f64, y: f64, z: f64) -> Unit<Vector3<f64>> {
        unit(Vector3::new(x, y, z)).expect("has a direction")
    }

    #[test]
    fn residual_is_the_rotation_across_the_reference_for_any_angle() {
        let reference = direction(0.3, -0.5, 0.9);
        let axis = across(&reference).column(1).into_owned();
        for angle in [0.0, 1e-9, 1e-3, 9.9e-3, 1.1e-2, 1.0, 1.6, 3.1, PI - 1e-6] {
            // The measured direction as the estimate sees it when it is wrong by `angle`.
            let measured = quaternion_exp(&(axis * -angle)) * reference.into_inner();
            let residual = direction_residual(&measured, &reference);
            assert!((residual - axis * angle).norm() < 1e-9 * (1.0 + angle), "{angle}");
        }
        let opposite = direction_residual(&-reference.into_inner(), &reference);
        assert!((opposite.norm() - PI).abs() < 1e-12 && opposite.dot(&reference).abs() < 1e-12);
    }

    #[test]
    fn heading_sensitivity_is_the_derivative() {
        let reference = direction(0.4, 0.2, -0.8);
        let (_, slope) = heading_residual(&reference, &reference);
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let step = 1e-6;
            let at = |d: f64| {
                let measured = quaternion_exp(&(axis * -d)) * reference.into_inner();
                heading_residual(&measured, &reference).0
            };
            let numeric = (at(step) - at(-step)) / (2.0 * step);
            assert!((numeric - slope.dot(&axis)).abs() < 1e-8);
        }
    }

    #[test]
    fn across_is_orthonormal() {
        for d in [direction(0.0, 0.0, 1.0), direction(1.0, 1.0, 1.0), direction(-1.0, 0.0, 0.0)] {
            let columns = across(&d);
            assert!((columns.tr_mul(&columns) - nalgebra::Matrix2::identity()).amax() < 1e-15);
            assert!(components(&columns, &d).norm() < 1e-15);
        }
    }
}
