//! Modified Rodrigues parameters with their shadow set.

use crate::skew;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Modified Rodrigues parameters `sigma = axis * tan(angle / 4)` of `q_world_body`.
///
/// The set is singular at a full turn; the shadow set `-sigma / |sigma|^2` is the same
/// attitude the other way round, so one of the two always has norm one or less.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModifiedRodrigues {
    /// The three parameters.
    pub sigma: Vector3<f64>,
}

impl ModifiedRodrigues {
    /// The set of the shorter way: `|sigma| <= 1`.
    #[must_use]
    pub fn from_quaternion(q_world_body: &UnitQuaternion<f64>) -> Self {
        // With the scalar part at least zero, 1 + w never approaches zero.
        let sign = if q_world_body.w < 0.0 { -1.0 } else { 1.0 };
        Self { sigma: q_world_body.imag() * (sign / (1.0 + sign * q_world_body.w)) }
    }

    /// The attitude, for any finite parameters.
    #[must_use]
    pub fn to_quaternion(&self) -> UnitQuaternion<f64> {
        let squared = self.sigma.norm_squared();
        let scale = 1.0 / (1.0 + squared);
        UnitQuaternion::new_normalize(Quaternion::from_parts(
            (1.0 - squared) * scale,
            self.sigma * (2.0 * scale),
        ))
    }

    /// The other set of the same attitude; `None` at the identity, whose shadow is infinite.
    #[must_use]
    pub fn shadow(&self) -> Option<Self> {
        let squared = self.sigma.norm_squared();
        let sigma = self.sigma / -squared;
        sigma.iter().all(|c| c.is_finite()).then_some(Self { sigma })
    }

    /// This set or its shadow, whichever has norm one or less.
    #[must_use]
    pub fn shortest(&self) -> Self {
        if self.sigma.norm_squared() > 1.0 { self.shadow().unwrap_or(*self) } else { *self }
    }

    /// The matrix of eq. (4.7): `sigma_dot = B(sigma) * omega_wb_b`.
    #[must_use]
    pub fn rate_matrix(&self) -> Matrix3<f64> {
        let s = &self.sigma;
        (Matrix3::identity() * (1.0 - s.norm_squared()) + skew(s) * 2.0 + s * s.transpose() * 2.0) * 0.25
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{integrate_rate, quaternion_exp};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    #[test]
    fn quarter_turn_matches_the_tangent() {
        let q = quaternion_exp(&Vector3::new(0.0, PI / 2.0, 0.0));
        let sigma = ModifiedRodrigues::from_quaternion(&q).sigma;
        // tan(22.5 deg) = sqrt(2) - 1.
        assert!((sigma - Vector3::new(0.0, 2f64.sqrt() - 1.0, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn identity_has_no_shadow() {
        let identity = ModifiedRodrigues { sigma: Vector3::zeros() };
        assert_eq!(identity.shadow(), None);
        assert_eq!(identity.shortest(), identity);
    }

    proptest! {
        #[test]
        fn round_trip_and_shadow_are_the_same_attitude(v in prop::array::uniform3(-6.0..6.0_f64)) {
            let q = quaternion_exp(&Vector3::from(v));
            let set = ModifiedRodrigues::from_quaternion(&q);
            prop_assert!(set.sigma.norm() <= 1.0 + 1e-15);
            prop_assert!(set.to_quaternion().angle_to(&q) < 1e-7);
            if let Some(shadow) = set.shadow() {
                prop_assert!(shadow.to_quaternion().angle_to(&q) < 1e-7);
                prop_assert!((shadow.shortest().sigma - set.sigma).norm() < 1e-10);
            }
        }

        #[test]
        fn rate_matrix_is_the_derivative(
            v in prop::array::uniform3(-1.5..1.5_f64), w in prop::array::uniform3(-2.0..2.0_f64),
        ) {
            let (q, omega, step) = (quaternion_exp(&Vector3::from(v)), Vector3::from(w), 1e-6);
            let at = |dt| ModifiedRodrigues::from_quaternion(&integrate_rate(&q, &omega, dt)).sigma;
            let numeric = (at(step) - at(-step)) / (2.0 * step);
            let analytic = ModifiedRodrigues::from_quaternion(&q).rate_matrix() * omega;
            prop_assert!((numeric - analytic).norm() < 1e-8);
        }
    }
}
