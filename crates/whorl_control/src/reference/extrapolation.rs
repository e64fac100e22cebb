//! Carrying a reference to another instant, and to rest when it is no longer renewed.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::quaternion_exp;

use super::Reference;

impl Reference {
    /// The reference `dt_s` later (earlier when negative), its acceleration in reference axes held
    /// constant.
    ///
    /// With `omega(t) = omega + a t` the attitude is `q exp(phi)`, and the Magnus series gives
    /// `phi = omega t + a t^2/2 + (omega x a) t^3/12 + O(t^5)` (W. Magnus, Comm. Pure Appl. Math. 7,
    /// 1954; A. Iserles et al., Acta Numerica 9, 2000, for right-trivialised equations the sign of
    /// the bracket turns). Exact when rate and acceleration are parallel; otherwise
    /// the error is of order `|a| |omega x a| t^5 / 240`: 5e-6 rad after a second and 2e-9 rad after
    /// 0.2 s at 0.3 rad/s and 0.05 rad/s^2.
    #[must_use]
    pub fn extrapolated(&self, dt_s: f64) -> Self {
        let (omega, acceleration) = (self.omega_wr_r_rad_s, self.omega_dot_wr_r_rad_s2);
        let turned = omega * dt_s
            + acceleration * (0.5 * dt_s * dt_s)
            + omega.cross(&acceleration) * (dt_s * dt_s * dt_s / 12.0);
        Self {
            q_world_reference: renormalised(self.q_world_reference * quaternion_exp(&turned)),
            omega_wr_r_rad_s: omega + acceleration * dt_s,
            omega_dot_wr_r_rad_s2: acceleration,
        }
    }

    /// The reference `elapsed_s` after it was left alone and began to come to rest.
    ///
    /// The axis of rotation stays, the rate falls along `1 - 3 x^2 + 2 x^3`, `x = elapsed / T`,
    /// with `T = 1.5 |omega| / deceleration`, so the angular deceleration starts and ends at zero
    /// and never exceeds `deceleration_rad_s2` (> 0). It turns by another `|omega| T / 2` on the way.
    #[must_use]
    pub fn coming_to_rest(&self, elapsed_s: f64, deceleration_rad_s2: f64) -> Self {
        let rate = self.omega_wr_r_rad_s.norm();
        if rate <= f64::MIN_POSITIVE || deceleration_rad_s2.is_nan() || deceleration_rad_s2 <= 0.0 {
            return Self::at_rest(self.q_world_reference);
        }
        let duration_s = 1.5 * rate / deceleration_rad_s2;
        let x = (elapsed_s / duration_s).clamp(0.0, 1.0);
        let rate_share = 1.0 - x * x * (3.0 - 2.0 * x);
        let equivalent_s = duration_s * x * (1.0 - x * x * (1.0 - 0.5 * x));
        let slope_per_s = -6.0 * x * (1.0 - x) / duration_s;
        Self {
            q_world_reference: renormalised(
                self.q_world_reference * quaternion_exp(&(self.omega_wr_r_rad_s * equivalent_s)),
            ),
            omega_wr_r_rad_s: self.omega_wr_r_rad_s * rate_share,
            omega_dot_wr_r_rad_s2: self.omega_wr_r_rad_s * slope_per_s,
        }
    }
}

/// The course of a reference over time: extrapolated while valid, then brought to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Validity {
    /// How long after its stamp the reference may be extrapolated \[s\], >= 0.
    pub valid_for_s: f64,
    /// Largest angular deceleration afterwards \[rad/s^2\], > 0.
    pub deceleration_rad_s2: f64,
}

/// A reference brought to the instant of use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extrapolated {
    /// The reference.
    pub reference: Reference,
    /// False when it has expired: it is coming to rest, or at rest.
    pub fresh: bool,
}

impl Validity {
    /// The reference `age_s` after its stamp. A small negative age (a reference for an instant ahead
    /// of the measurement) extrapolates backwards.
    #[must_use]
    pub fn apply(&self, reference: &Reference, age_s: f64) -> Extrapolated {
        if age_s <= self.valid_for_s {
            return Extrapolated { reference: reference.extrapolated(age_s), fresh: true };
        }
        let last = reference.extrapolated(self.valid_for_s);
        Extrapolated {
            reference: last.coming_to_rest(age_s - self.valid_for_s, self.deceleration_rad_s2),
            fresh: false,
        }
    }
}

/// Keeps products of many unit quaternions at unit norm.
fn renormalised(mut q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    q.renormalize_fast();
    q
}

/// Limits the length of a vector, keeping its direction.
pub(super) fn limited(vector: Vector3<f64>, max: f64) -> Vector3<f64> {
    let norm = vector.norm();
    if norm > max { vector * (max / norm) } else { vector }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::{attitude_error, integrate_rate};

    fn moving() -> Reference {
        Reference {
            q_world_reference: UnitQuaternion::from_euler_angles(0.1, -0.2, 0.9),
            omega_wr_r_rad_s: Vector3::new(0.05, -0.02, 0.3),
            omega_dot_wr_r_rad_s2: Vector3::new(-0.02, 0.04, 0.01),
        }
    }

    /// Midpoint integration in small steps: an independent route to the attitude.
    fn integrated(start: &Reference, duration_s: f64) -> UnitQuaternion<f64> {
        let steps = 20_000;
        let dt = duration_s / f64::from(steps);
        (0..steps).fold(start.q_world_reference, |q, k| {
            let middle = (f64::from(k) + 0.5) * dt;
            integrate_rate(&q, &(start.omega_wr_r_rad_s + start.omega_dot_wr_r_rad_s2 * middle), dt)
        })
    }

    #[test]
    fn extrapolation_agrees_with_fine_integration() {
        let start = moving();
        // Fifth order: a fifth of the age leaves 1/3125 of the error.
        for (age_s, tolerance) in [(1.0, 5e-6), (0.2, 2e-9)] {
            let after = start.extrapolated(age_s);
            let error = attitude_error(&integrated(&start, age_s), &after.q_world_reference).norm();
            assert!(error < tolerance, "{age_s}: {error}");
        }
        let after = start.extrapolated(1.0);
        // The third-order term matters at this size: without it the error would be |w x a|/12.
        assert!(start.omega_wr_r_rad_s.cross(&start.omega_dot_wr_r_rad_s2).norm() / 12.0 > 1e-4);
        assert!((after.omega_wr_r_rad_s - Vector3::new(0.03, 0.02, 0.31)).norm() < 1e-15);
    }

    #[test]
    fn forth_and_back_is_where_it_started() {
        let back = moving().extrapolated(0.4).extrapolated(-0.4);
        assert!(attitude_error(&moving().q_world_reference, &back.q_world_reference).norm() < 1e-7);
    }

    #[test]
    fn a_stale_reference_comes_to_rest_smoothly_and_within_its_deceleration() {
        let validity = Validity { valid_for_s: 0.2, deceleration_rad_s2: 0.1 };
        let start = Reference { omega_dot_wr_r_rad_s2: Vector3::zeros(), ..moving() };
        let dt = 1e-3;
        let mut previous = validity.apply(&start, 0.0).reference;
        let mut largest = 0.0_f64;
        for k in 1..8000 {
            let now = validity.apply(&start, f64::from(k) * dt);
            assert_eq!(now.fresh, f64::from(k) * dt <= 0.2);
            let r = now.reference;
            let mean_rate = (previous.omega_wr_r_rad_s + r.omega_wr_r_rad_s) / 2.0;
            let moved = attitude_error(&previous.q_world_reference, &r.q_world_reference);
            let mismatch = (moved / dt - mean_rate).norm();
            assert!(mismatch < 1e-7, "rate is the derivative of the attitude: {mismatch} at {k}");
            let slope = (r.omega_wr_r_rad_s - previous.omega_wr_r_rad_s) / dt;
            let mean_slope = (previous.omega_dot_wr_r_rad_s2 + r.omega_dot_wr_r_rad_s2) / 2.0;
            assert!((slope - mean_slope).norm() < 5e-5);
            largest = largest.max(slope.norm());
            previous = r;
        }
        assert!(largest <= 0.1 + 1e-9 && largest > 0.099, "{largest}");
        assert_eq!(previous.omega_wr_r_rad_s, Vector3::zeros());
        let rate = start.omega_wr_r_rad_s.norm();
        let expected = rate * 0.2 + rate * (1.5 * rate / 0.1) / 2.0;
        let turned = attitude_error(&start.q_world_reference, &previous.q_world_reference).norm();
        assert!((turned - expected).abs() < 1e-9);
    }

    #[test]
    fn offset_frame_moves_with_its_reference() {
        let offset = UnitQuaternion::from_euler_angles(0.0, 0.3, -1.2);
        let (start, dt) = (moving(), 1e-5);
        let turned = start.with_offset(&offset);
        let later = start.extrapolated(dt).with_offset(&offset);
        let rate = attitude_error(&turned.q_world_reference, &later.q_world_reference) / dt;
        assert!((rate - turned.omega_wr_r_rad_s).norm() < 1e-5);
        assert!((turned.omega_wr_r_rad_s.norm() - start.omega_wr_r_rad_s.norm()).abs() < 1e-15);
    }
}
