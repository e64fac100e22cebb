//! Attitudes that the air bearing allows.
//!
//! A tabletop (Whorl-I) limits the angle between body z and the vertical; a dumbbell (Whorl-II)
//! limits the elevation of body x and leaves yaw and roll free. Both are one scalar of the attitude,
//! the *limited angle*, that grows at one radian per radian of rotation about one horizontal axis.

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_dynamics::platform::TiltLimit;
use whorl_math::{elevation_x_rad, quaternion_exp, tilt_rad, unit_or};

use super::Reference;

/// The freedom of a bearing, less a margin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltEnvelope {
    limit: TiltLimit,
    max_rad: f64,
}

/// Why an envelope was refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum EnvelopeError {
    /// The margin is negative, not finite, or not less than the limit.
    #[error("tilt margin {margin_rad} rad must be at least 0 and less than the limit of {limit_rad} rad")]
    Margin {
        /// The refused margin.
        margin_rad: f64,
        /// The bearing's limit.
        limit_rad: f64,
    },
}

impl TiltEnvelope {
    /// The attitudes at least `margin_rad` inside the bearing's limit.
    ///
    /// # Errors
    /// [`EnvelopeError::Margin`] when the margin does not fit the limit.
    pub fn new(limit: TiltLimit, margin_rad: f64) -> Result<Self, EnvelopeError> {
        let (TiltLimit::Cone { max_rad: limit_rad } | TiltLimit::Pitch { max_rad: limit_rad }) = limit;
        if margin_rad >= 0.0 && margin_rad < limit_rad {
            Ok(Self { limit, max_rad: limit_rad - margin_rad })
        } else {
            Err(EnvelopeError::Margin { margin_rad, limit_rad })
        }
    }

    /// Largest allowed value of the limited angle \[rad\].
    #[must_use]
    pub fn max_rad(&self) -> f64 {
        self.max_rad
    }

    /// The bearing's own limit, without the margin.
    #[must_use]
    pub fn limit(&self) -> TiltLimit {
        self.limit
    }

    /// The limited angle of an attitude \[rad\], >= 0: tilt of body z from the vertical, or magnitude
    /// of the elevation of body x.
    #[must_use]
    pub fn angle_rad(&self, q_world_body: &UnitQuaternion<f64>) -> f64 {
        match self.limit {
            TiltLimit::Cone { .. } => tilt_rad(q_world_body),
            TiltLimit::Pitch { .. } => elevation_x_rad(q_world_body).abs(),
        }
    }

    /// Whether an attitude lies inside.
    #[must_use]
    pub fn contains(&self, q_world_body: &UnitQuaternion<f64>) -> bool {
        self.angle_rad(q_world_body) <= self.max_rad
    }

    /// The unit axis, in world axes, about which a positive rotation raises the limited angle
    /// at one radian per radian. It is horizontal.
    #[must_use]
    pub fn outward_axis_w(&self, q_world_body: &UnitQuaternion<f64>) -> Vector3<f64> {
        let up = Vector3::z();
        match self.limit {
            TiltLimit::Cone { .. } => {
                let z_w = q_world_body * Vector3::z();
                unit_or(up.cross(&z_w), Vector3::x_axis()).into_inner()
            }
            TiltLimit::Pitch { .. } => {
                let x_w = q_world_body * Vector3::x();
                let axis = unit_or(x_w.cross(&up), Vector3::y_axis()).into_inner();
                if x_w.z < 0.0 { -axis } else { axis }
            }
        }
    }

    /// How fast the limited angle grows at a body rate \[rad/s\]; negative when it falls.
    #[must_use]
    pub fn outward_rate_rad_s(
        &self,
        q_world_body: &UnitQuaternion<f64>,
        omega_wb_b_rad_s: &Vector3<f64>,
    ) -> f64 {
        (q_world_body * omega_wb_b_rad_s).dot(&self.outward_axis_w(q_world_body))
    }

    /// The nearest allowed attitude, and whether it differs. Heading (and, for a dumbbell, roll)
    /// stay as they are.
    #[must_use]
    pub fn clip(&self, q_world_body: &UnitQuaternion<f64>) -> (UnitQuaternion<f64>, bool) {
        let excess_rad = self.angle_rad(q_world_body) - self.max_rad;
        if excess_rad > 0.0 {
            let back = quaternion_exp(&(self.outward_axis_w(q_world_body) * -excess_rad));
            (back * q_world_body, true)
        } else {
            (*q_world_body, false)
        }
    }

    /// Clips the attitude of a moving reference and stops what would take it further out.
    #[must_use]
    pub fn clip_reference(&self, reference: &Reference) -> (Reference, bool) {
        let (q_world_reference, clipped) = self.clip(&reference.q_world_reference);
        if !clipped {
            return (*reference, false);
        }
        let outward_r = q_world_reference.inverse() * self.outward_axis_w(&q_world_reference);
        let inward_only = |v: &Vector3<f64>| v - outward_r * v.dot(&outward_r).max(0.0);
        let clipped_reference = Reference {
            q_world_reference,
            omega_wr_r_rad_s: inward_only(&reference.omega_wr_r_rad_s),
            omega_dot_wr_r_rad_s2: inward_only(&reference.omega_dot_wr_r_rad_s2),
        };
        (clipped_reference, true)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::f64::consts::PI;
    use whorl_math::{azimuth_rad, integrate_rate, roll_rad};

    pub(crate) fn tabletop() -> TiltEnvelope {
        TiltEnvelope::new(TiltLimit::Cone { max_rad: 5.0_f64.to_radians() }, 1.0_f64.to_radians()).unwrap()
    }

    pub(crate) fn dumbbell() -> TiltEnvelope {
        TiltEnvelope::new(TiltLimit::Pitch { max_rad: 30.0_f64.to_radians() }, 2.0_f64.to_radians()).unwrap()
    }

    #[test]
    fn margins_that_leave_nothing_are_refused() {
        let limit = TiltLimit::Cone { max_rad: 0.1 };
        for margin in [-0.01, 0.1, 0.2, f64::NAN] {
            assert!(TiltEnvelope::new(limit, margin).is_err(), "{margin}");
        }
    }

    #[test]
    fn the_limited_angle_grows_with_the_outward_rate() {
        for envelope in [tabletop(), dumbbell()] {
            for (roll, pitch, yaw) in [(0.02, -0.05, 1.0), (0.03, 0.2, -2.0), (-0.04, 0.06, 3.0)] {
                let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
                let omega = Vector3::new(0.3, -0.7, 0.2);
                let (dt, mut slope) = (1e-6, 0.0);
                for sign in [1.0, -1.0] {
                    slope += sign * envelope.angle_rad(&integrate_rate(&q, &omega, sign * dt)) / (2.0 * dt);
                }
                assert!((slope - envelope.outward_rate_rad_s(&q, &omega)).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn clipping_a_tabletop_keeps_the_lean_direction() {
        let lean = |tilt: f64| quaternion_exp(&(Vector3::new(0.6, 0.8, 0.0) * tilt));
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.5);
        let (clipped, changed) = tabletop().clip(&(lean(0.2) * yaw));
        assert!(changed);
        assert!(clipped.angle_to(&(lean(4.0_f64.to_radians()) * yaw)) < 1e-7);
        let inside = lean(0.05) * yaw;
        assert_eq!(tabletop().clip(&inside), (inside, false));
    }

    #[test]
    fn clipping_a_dumbbell_keeps_yaw_and_roll() {
        for pitch in [-1.0, 1.2] {
            let q = UnitQuaternion::from_euler_angles(2.0, pitch, -0.7);
            let (clipped, changed) = dumbbell().clip(&q);
            assert!(changed);
            assert!((dumbbell().angle_rad(&clipped) - dumbbell().max_rad()).abs() < 1e-12);
            assert!((roll_rad(&clipped) - 2.0).abs() < 1e-12 && (azimuth_rad(&clipped) + 0.7).abs() < 1e-12);
        }
        let rolled = UnitQuaternion::from_euler_angles(PI - 0.1, 0.1, 0.4);
        assert!(!dumbbell().clip(&rolled).1, "roll is free");
    }

    #[test]
    fn upside_down_has_an_answer() {
        let q = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        assert!((tabletop().angle_rad(&tabletop().clip(&q).0) - tabletop().max_rad()).abs() < 1e-9);
    }

    #[test]
    fn a_clipped_reference_does_not_move_outwards() {
        let reference = Reference {
            q_world_reference: UnitQuaternion::from_euler_angles(0.15, 0.0, 0.8),
            omega_wr_r_rad_s: Vector3::new(0.1, 0.02, 0.3),
            omega_dot_wr_r_rad_s2: Vector3::new(0.01, 0.0, 0.0),
        };
        let (clipped, changed) = tabletop().clip_reference(&reference);
        assert!(changed);
        let outward = tabletop().outward_rate_rad_s(&clipped.q_world_reference, &clipped.omega_wr_r_rad_s);
        assert!(outward.abs() < 1e-12, "{outward}");
        // What turns about the vertical goes on.
        assert!((clipped.q_world_reference * clipped.omega_wr_r_rad_s).z > 0.25);
    }
}
