//! Constants and unit conversions, defined once for the workspace.

use std::f64::consts::{PI, TAU};

/// Gravity in the laboratory \[m/s^2\], the value of the dissertation (after eq. 4.40).
pub const GRAVITY_M_S2: f64 = 9.81;

/// 0 degrees Celsius \[K\].
pub const CELSIUS_ZERO_K: f64 = 273.15;

/// Degrees to radians.
#[must_use]
pub fn rad_from_deg(angle_deg: f64) -> f64 {
    angle_deg.to_radians()
}

/// Radians to degrees.
#[must_use]
pub fn deg_from_rad(angle_rad: f64) -> f64 {
    angle_rad.to_degrees()
}

/// Revolutions per minute to rad/s.
#[must_use]
pub fn rad_s_from_rpm(speed_rpm: f64) -> f64 {
    speed_rpm * (TAU / 60.0)
}

/// rad/s to revolutions per minute.
#[must_use]
pub fn rpm_from_rad_s(speed_rad_s: f64) -> f64 {
    speed_rad_s * (60.0 / TAU)
}

/// The same angle in `(-pi, pi]`; NaN and infinities give NaN.
#[must_use]
pub fn wrap_angle_rad(angle_rad: f64) -> f64 {
    let wrapped = angle_rad.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversions_match_hand_values() {
        assert!((rad_s_from_rpm(60.0) - TAU).abs() < 1e-15);
        assert!((rpm_from_rad_s(TAU) - 60.0).abs() < 1e-13);
        assert!((rad_from_deg(180.0) - PI).abs() < 1e-15);
        assert!((deg_from_rad(PI / 6.0) - 30.0).abs() < 1e-13);
    }

    #[test]
    fn wrapping_keeps_pi_and_handles_both_signs() {
        assert_eq!(wrap_angle_rad(PI), PI);
        assert_eq!(wrap_angle_rad(-PI), PI);
        assert!((wrap_angle_rad(-0.1) + 0.1).abs() < 1e-15);
        assert!((wrap_angle_rad(3.0 * TAU + 0.2) - 0.2).abs() < 1e-13);
        assert!(wrap_angle_rad(f64::INFINITY).is_nan());
    }
}
