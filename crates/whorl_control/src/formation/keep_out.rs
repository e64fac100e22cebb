//! A direction that a body axis must not point near: a bright lamp, or the sun of the rehearsed orbit.
//!
//! # Equations
//!
//! With boresight b, forbidden direction s, `z` the angle between them, `d = z - z_min` the distance left and
//! `n = (b x s)/|b x s|` in body axes (turning about `-n` is turning away: `z' = -omega . n`):
//!
//! ```text
//! pull away   a = k (d0/d - 1) d0^2/d^2 n',  n' = -n,  for d < d0  (Khatib's potential)
//! brake       omega' . n' >= v^2 / (2 d),  v = omega . n > 0 the speed of approach, for d < d0
//! ```
//!
//! # Source
//! O. Khatib, "Real-time obstacle avoidance for manipulators and mobile robots", Int. J. Robotics Research 5(1),
//! 1986; the brake is a control barrier function, A. D. Ames et al., IEEE Trans. Automatic Control 62(8), 2017;
//! attitude keep-out: C. R. McInnes, "Large angle slew maneuvers with autonomous sun vector avoidance", J.
//! Guidance, Control, and Dynamics 17(4), 1994.
//!
//! # Guarantee
//! Braking at `v^2/(2d)` brings the approach to rest at `d = 0` and needs no more than it did at `d0`:
//! `rate_max^2/(2 d0)`. With `d0 >= rate_max^2 / a_max` that is half the acceleration, so the cone is never
//! entered from outside, whatever the other behaviours ask. A cone exactly between start and goal can stop
//! the boresight in front of it: a potential has saddles.

use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::{Allowed, Settings};

/// Nearer to the cone than this the brake is computed as if at this distance \[rad\].
const NEAREST_RAD: f64 = 1e-6;

/// The forbidden cone of one body axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeepOut {
    /// Body axis that must stay away.
    pub boresight_body: Unit<Vector3<f64>>,
    /// Direction that it stays away from, world axes.
    pub direction_world: Unit<Vector3<f64>>,
    /// Half angle of the cone \[rad\], > 0.
    pub half_angle_rad: f64,
    /// Distance from the cone at which avoidance begins: `d0` \[rad\].
    pub influence_rad: f64,
    /// Weight of the pull away: its natural frequency \[rad/s\].
    pub bandwidth_rad_s: f64,
}

/// How a boresight stands to its cone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Approach {
    /// Distance left \[rad\]; negative inside.
    pub distance_rad: f64,
    /// Turning about this body axis is turning away.
    away_body: Vector3<f64>,
}

impl KeepOut {
    pub(super) fn read(settings: &mut dyn Settings) -> Self {
        Self {
            boresight_body: settings
                .direction("boresight_body", "body axis that must stay away, e.g. [1.0, 0.0, 0.0]"),
            direction_world: settings
                .direction("direction_world", "direction that it stays away from (east, north, up)"),
            half_angle_rad: settings
                .number(
                    "half_angle_deg",
                    Allowed::between(0.1, 80.0),
                    "half angle of the forbidden cone [deg]",
                )
                .to_radians(),
            influence_rad: settings
                .number(
                    "influence_deg",
                    Allowed::POSITIVE,
                    "distance from the cone at which avoidance begins; at least rate_max^2 / acceleration_max [deg]",
                )
                .to_radians(),
            bandwidth_rad_s: settings.number_or(
                "bandwidth_rad_s",
                0.1,
                Allowed::between(0.0, 2.0),
                "weight of the avoidance [rad/s]",
            ),
        }
    }

    /// Angle left between the boresight of an attitude and the cone \[rad\]; negative inside.
    #[must_use]
    pub fn distance_rad(&self, q_world_body: &UnitQuaternion<f64>) -> f64 {
        self.approach(q_world_body).distance_rad
    }

    pub(super) fn approach(&self, q_world_body: &UnitQuaternion<f64>) -> Approach {
        let direction = q_world_body.inverse() * self.direction_world.into_inner();
        let normal = self.boresight_body.cross(&direction);
        let sine = normal.norm();
        let angle = sine.atan2(self.boresight_body.dot(&direction));
        // Exactly at the centre every way leads out.
        let towards = if sine > 1e-12 { normal / sine } else { any_normal(&self.boresight_body) };
        Approach { distance_rad: angle - self.half_angle_rad, away_body: -towards }
    }

    /// Acceleration that turns away \[rad/s^2\].
    pub(super) fn pull_rad_s2(&self, approach: &Approach) -> Vector3<f64> {
        let (d, d0) = (approach.distance_rad.max(NEAREST_RAD), self.influence_rad);
        if approach.distance_rad >= d0 {
            return Vector3::zeros();
        }
        let ratio = d0 / d;
        approach.away_body * (self.bandwidth_rad_s.powi(2) * d0 * (ratio - 1.0) * ratio * ratio)
    }

    /// `acceleration` with at least what stops the approach in front of the cone, at most `max_rad_s2` more.
    pub(super) fn braked_rad_s2(
        &self,
        approach: &Approach,
        omega_b_rad_s: &Vector3<f64>,
        acceleration_rad_s2: Vector3<f64>,
        max_rad_s2: f64,
    ) -> Vector3<f64> {
        let closing = -omega_b_rad_s.dot(&approach.away_body);
        if approach.distance_rad >= self.influence_rad || closing <= 0.0 {
            return acceleration_rad_s2;
        }
        let needed = (closing * closing / (2.0 * approach.distance_rad.max(NEAREST_RAD))).min(max_rad_s2);
        let missing = needed - acceleration_rad_s2.dot(&approach.away_body);
        acceleration_rad_s2 + approach.away_body * missing.max(0.0)
    }
}

fn any_normal(axis: &Unit<Vector3<f64>>) -> Vector3<f64> {
    let other = if axis.z.abs() < 0.9 { Vector3::z_axis() } else { Vector3::x_axis() };
    Unit::new_normalize(axis.cross(&other)).into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::quaternion_exp;

    fn lamp() -> KeepOut {
        KeepOut {
            boresight_body: Vector3::x_axis(),
            direction_world: Vector3::x_axis(),
            half_angle_rad: 0.1,
            influence_rad: 0.1,
            bandwidth_rad_s: 0.2,
        }
    }

    #[test]
    fn turning_about_the_way_out_opens_the_angle_at_its_full_rate() {
        let keep_out = lamp();
        let q = quaternion_exp(&Vector3::new(0.3, 0.1, 0.12));
        let at = keep_out.approach(&q);
        let later = keep_out.approach(&(q * quaternion_exp(&(at.away_body * 1e-6))));
        assert!(((later.distance_rad - at.distance_rad) / 1e-6 - 1.0).abs() < 1e-5);
    }

    #[test]
    fn the_pull_begins_at_the_influence_and_is_the_slope_of_its_potential() {
        let keep_out = lamp();
        let potential = |d: f64| 0.5 * 0.04 * 0.01 * (0.1 / d - 1.0).powi(2);
        for d in [0.02, 0.05, 0.09] {
            let q = quaternion_exp(&Vector3::new(0.0, 0.0, 0.1 + d));
            let pull = keep_out.pull_rad_s2(&keep_out.approach(&q)).z;
            let slope = -(potential(d + 1e-7) - potential(d - 1e-7)) / 2e-7;
            assert!((pull / slope - 1.0).abs() < 1e-5, "{d}: {pull} {slope}");
        }
        let outside = quaternion_exp(&Vector3::new(0.0, 0.0, 0.21));
        assert_eq!(keep_out.pull_rad_s2(&keep_out.approach(&outside)), Vector3::zeros());
    }

    #[test]
    fn the_brake_stops_in_front_of_the_cone() {
        let keep_out = lamp();
        // Headed straight for the lamp at 0.05 rad/s while everything else pushes on.
        let (mut angle, mut rate) = (0.2_f64, -0.05_f64);
        for _ in 0..5000 {
            let q = quaternion_exp(&Vector3::new(0.0, 0.0, angle));
            let at = keep_out.approach(&q);
            let omega = Vector3::new(0.0, 0.0, rate);
            let a = keep_out.braked_rad_s2(&at, &omega, Vector3::new(0.0, 0.0, -0.02), 0.05).z;
            rate += a * 0.02;
            angle += rate * 0.02;
            assert!(angle > 0.1 - 1e-4, "{angle}");
        }
    }
}
