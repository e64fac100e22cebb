//! Attitude kinematics and the angles that a user reads.

use crate::{attitude_from_two_vectors, quaternion_exp, rotation_vector, unit_or};
use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

/// The attitude after `dt_s` at the constant body rate `omega_wb_b_rad_s`.
///
/// Exact for a constant rate; the norm is held at one by a Newton step.
#[must_use]
#[inline]
pub fn integrate_rate(
    q_world_body: &UnitQuaternion<f64>,
    omega_wb_b_rad_s: &Vector3<f64>,
    dt_s: f64,
) -> UnitQuaternion<f64> {
    let mut q = q_world_body * quaternion_exp(&(omega_wb_b_rad_s * dt_s));
    q.renormalize_fast();
    q
}

/// `q_dot = 1/2 q (x) [0, omega]` \[1/s\]: eq. (4.6) with the factor that it omits.
#[must_use]
#[inline]
pub fn quaternion_rate(
    q_world_body: &UnitQuaternion<f64>,
    omega_wb_b_rad_s: &Vector3<f64>,
) -> Quaternion<f64> {
    let (w, v) = (q_world_body.w, q_world_body.imag());
    let half = 0.5 * omega_wb_b_rad_s;
    Quaternion::from_parts(-v.dot(&half), half * w + v.cross(&half))
}

/// The upward vertical in body axes, `R^T k`: a unit vector.
#[must_use]
#[inline]
pub fn vertical_b(q_world_body: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (w, x, y, z) = (q_world_body.w, q_world_body.i, q_world_body.j, q_world_body.k);
    Vector3::new(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
}

/// Angle between body z and world z, in `[0, pi]` \[rad\]; accurate near zero.
#[must_use]
pub fn tilt_rad(q_world_body: &UnitQuaternion<f64>) -> f64 {
    let vertical = vertical_b(q_world_body);
    vertical.x.hypot(vertical.y).atan2(vertical.z)
}

/// Azimuth of body x in the horizontal plane, from east towards north, in `(-pi, pi]` \[rad\]:
/// the yaw angle. Zero when body x is exactly vertical and has none.
#[must_use]
pub fn azimuth_rad(q_world_body: &UnitQuaternion<f64>) -> f64 {
    let x_world = q_world_body * Vector3::x();
    x_world.y.atan2(x_world.x)
}

/// Elevation of body x above the horizon, in `[-pi/2, pi/2]` \[rad\].
///
/// The pitch angle about body y (REP-103, positive nose down) is its negative.
#[must_use]
pub fn elevation_x_rad(q_world_body: &UnitQuaternion<f64>) -> f64 {
    let vertical = vertical_b(q_world_body);
    vertical.x.atan2(vertical.y.hypot(vertical.z))
}

/// Roll about body x (last angle of the yaw-pitch-roll sequence), in `(-pi, pi]` \[rad\];
/// zero when body x is exactly vertical.
#[must_use]
pub fn roll_rad(q_world_body: &UnitQuaternion<f64>) -> f64 {
    let vertical = vertical_b(q_world_body);
    vertical.y.atan2(vertical.z)
}

/// Error of the actual attitude against a reference, as a rotation vector in body axes \[rad\]:
/// `q_actual = q_reference * exp(error)`, the shortest way.
#[must_use]
#[inline]
pub fn attitude_error(q_reference: &UnitQuaternion<f64>, q_actual: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation_vector(&(q_reference.inverse() * q_actual))
}

/// The attitude in which the world's vertical appears along `vertical_b` in body axes and
/// body x has the given azimuth \[rad\].
///
/// Where body x is vertical, and so has no azimuth, body -z takes its place (the limit of
/// pitching body x upwards).
#[must_use]
pub fn attitude_from_vertical(vertical_b: Unit<Vector3<f64>>, azimuth_rad: f64) -> UnitQuaternion<f64> {
    let along_x = vertical_b.x;
    // Both choices point to the azimuth when body x pitches up or down to the vertical.
    let marker_b = if along_x.abs() < 1.0 - 1e-12 { Vector3::x() } else { -Vector3::z() * along_x.signum() };
    let heading_w = Vector3::new(azimuth_rad.cos(), azimuth_rad.sin(), 0.0);
    let horizontal_b =
        unit_or(marker_b - vertical_b.into_inner() * vertical_b.dot(&marker_b), Vector3::x_axis());
    attitude_from_two_vectors(&vertical_b, &Vector3::z_axis(), &horizontal_b, &Unit::new_unchecked(heading_w))
        .unwrap_or_else(|_| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth_rad))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn attitude() -> impl Strategy<Value = UnitQuaternion<f64>> {
        prop::array::uniform3(-1.8..1.8_f64).prop_map(|v| quaternion_exp(&Vector3::from(v)))
    }

    #[test]
    fn constant_rate_integrates_exactly_and_keeps_the_norm() {
        let omega = Vector3::new(0.3, -0.2, 1.1);
        let mut q = UnitQuaternion::identity();
        for _ in 0..100_000 {
            q = integrate_rate(&q, &omega, 0.001);
        }
        assert!(attitude_error(&quaternion_exp(&(omega * 100.0)), &q).norm() < 1e-10);
        assert!((q.norm() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn small_tilts_keep_their_digits() {
        let q = quaternion_exp(&Vector3::new(3e-9, 4e-9, 0.0));
        assert!((tilt_rad(&q) - 5e-9).abs() < 1e-22);
    }

    #[test]
    fn vertical_start_covers_every_pole() {
        for v in [Vector3::x(), -Vector3::x(), -Vector3::z(), Vector3::y()] {
            let q = attitude_from_vertical(unit(v).expect("unit"), 0.7);
            assert!((vertical_b(&q) - v).norm() < 1e-12, "{v}");
        }
        // Nose straight up: body -z lies where the nose pointed before.
        let q = attitude_from_vertical(Vector3::x_axis(), 0.7);
        let belly = q * -Vector3::z();
        assert!((belly - Vector3::new(0.7_f64.cos(), 0.7_f64.sin(), 0.0)).norm() < 1e-12);
    }

    proptest! {
        #[test]
        fn rate_is_the_derivative(q in attitude(), w in prop::array::uniform3(-3.0..3.0_f64)) {
            let (omega, step) = (Vector3::from(w), 1e-6);
            let forward = integrate_rate(&q, &omega, step);
            let backward = integrate_rate(&q, &omega, -step);
            let numeric = (forward.coords - backward.coords) / (2.0 * step);
            prop_assert!((numeric - quaternion_rate(&q, &omega).coords).norm() < 1e-8);
        }

        #[test]
        fn angles_agree_with_nalgebra_euler_angles(q in attitude()) {
            let (roll, pitch, yaw) = q.euler_angles();
            prop_assume!(pitch.abs() < FRAC_PI_2 - 1e-3);
            prop_assert!((roll_rad(&q) - roll).abs() < 1e-10);
            prop_assert!((elevation_x_rad(&q) + pitch).abs() < 1e-10);
            prop_assert!((azimuth_rad(&q) - yaw).abs() < 1e-10);
        }

        #[test]
        fn tilt_is_the_angle_between_the_z_axes(q in attitude()) {
            let cosine = (q * Vector3::z()).z;
            prop_assert!((tilt_rad(&q).cos() - cosine).abs() < 1e-14);
            prop_assert!((vertical_b(&q) - q.inverse() * Vector3::z()).norm() < 1e-14);
        }

        #[test]
        fn error_reproduces_the_actual_attitude(a in attitude(), b in attitude()) {
            let error = attitude_error(&a, &b);
            prop_assert!(error.norm() <= PI + 1e-12);
            prop_assert!((a * quaternion_exp(&error)).angle_to(&b) < 1e-7);
        }

        #[test]
        fn vertical_start_has_the_asked_vertical_and_azimuth(
            v in prop::array::uniform3(-1.0..1.0_f64), azimuth in -3.0..3.0_f64,
        ) {
            prop_assume!(Vector3::from(v).norm() > 0.1);
            let vertical = unit(Vector3::from(v)).expect("long enough");
            let q = attitude_from_vertical(vertical, azimuth);
            prop_assert!((vertical_b(&q) - vertical.into_inner()).norm() < 1e-12);
            prop_assume!(vertical.x.abs() < 0.999);
            prop_assert!((azimuth_rad(&q) - azimuth).abs() < 1e-9);
        }
    }
}
