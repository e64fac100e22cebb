//! Attitudes in which several spacecraft point together, and their thrusters as far as the remaining freedom allows.
//!
//! # Equations
//!
//! Each spacecraft points its boresight along `r_T/S`, from itself to the target, and wants the velocity change of
//! its thruster along `dv`. The mission asks for the angle between both,
//!
//! ```text
//! theta_mission = acos( dv . r_T/S / (|dv| |r_T/S|) )                                   (2.38)
//! ```
//!
//! the spacecraft has `theta_config` between its boresight and the velocity change of its thruster. Both can be met
//! only if the two are equal. Else the mismatch `D = theta_mission - theta_config` is shared in the plane of both
//! directions: the boresight is off by `w D`, the thrust by `(1 - w) D`, with w from 0 (boresight exact) to 1
//! (thrust exact). That is the minimum of `(1 - w) error_boresight^2 + w error_thrust^2`.
//!
//! Source: Schwartz 2004, section 2.3 and Figure 2.1.
//!
//! # Assumptions
//! Targets on the ellipsoid of WGS 84 ([`crate::earth`]), at height zero; a thruster that is fixed in the body.

use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};
use thiserror::Error;

use crate::{EARTH_RATE_RAD_S, earth};

/// Directions closer than this are taken as parallel \[rad\].
const PARALLEL_RAD: f64 = 1e-9;
/// Velocity changes below this count as zero \[m/s\].
const NO_DELTA_V_M_S: f64 = 1e-9;

/// What is observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// The centroid of the points below the spacecraft.
    Centroid,
    /// A point of the Earth's surface by its geocentric latitude; [`Target::geodetic`] makes one from that of a map.
    Point {
        /// Geocentric latitude: of the line from the Earth's centre \[rad\].
        latitude_rad: f64,
        /// East longitude, from the inertial x axis at time 0 \[rad\].
        longitude_rad: f64,
    },
}

/// A target that cannot be observed.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum TargetError {
    /// The points below the spacecraft have no centroid.
    #[error("the spacecraft stand on opposite sides of the Earth: the points below them have no centroid")]
    NoCentroid,
    /// It is behind the horizon.
    #[error("the target is {below_deg:.1} deg below the horizon of spacecraft {spacecraft}")]
    BelowHorizon {
        /// Which.
        spacecraft: usize,
        /// By how much, as seen from the target \[deg\].
        below_deg: f64,
    },
}

/// The point straight below a spacecraft, in Earth-fixed axes that were the inertial ones at time 0 \[m\].
#[must_use]
pub fn ground_track_m(position_m: &Vector3<f64>, time_s: f64) -> Vector3<f64> {
    let to_earth = Rotation3::from_axis_angle(&Vector3::z_axis(), -EARTH_RATE_RAD_S * time_s);
    to_earth * earth::below_m(position_m)
}

impl Target {
    /// A point by its geodetic latitude, that of maps (WGS 84), and its east longitude from the inertial x axis at time 0
    /// \[rad\].
    #[must_use]
    pub fn geodetic(latitude_rad: f64, longitude_rad: f64) -> Self {
        Self::Point { latitude_rad: earth::geocentric_from_geodetic_rad(latitude_rad), longitude_rad }
    }

    /// Where the target is, inertial axes \[m\].
    ///
    /// # Errors
    /// No centroid.
    pub fn position_m(
        &self,
        spacecraft_m: &[Vector3<f64>],
        time_s: f64,
    ) -> Result<Vector3<f64>, TargetError> {
        match *self {
            Self::Centroid => {
                let sum: Vector3<f64> = spacecraft_m.iter().map(earth::below_m).sum();
                // Of some metres' length: the points lie around the whole Earth.
                let inside = Unit::try_new(sum, 1.0).ok_or(TargetError::NoCentroid)?;
                // Their mean lies inside the Earth; the centroid is the point of the surface nearest to it.
                Ok(earth::below_m(&(inside.into_inner() * (sum.norm() / spacecraft_m.len() as f64))))
            }
            Self::Point { latitude_rad, longitude_rad } => {
                let east = longitude_rad + EARTH_RATE_RAD_S * time_s;
                Ok(earth::surface_geocentric_m(latitude_rad, east))
            }
        }
    }
}

/// Elevation of a spacecraft above the target's horizon \[rad\].
#[must_use]
pub fn elevation_rad(target_m: &Vector3<f64>, spacecraft_m: &Vector3<f64>) -> f64 {
    let to_spacecraft = spacecraft_m - target_m;
    std::f64::consts::FRAC_PI_2 - to_spacecraft.angle(&earth::up(target_m))
}

/// How boresight and thruster are mounted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mounting {
    /// The boresight, body axes.
    pub boresight_body: Unit<Vector3<f64>>,
    /// The velocity change that the thruster gives (opposite its plume), body axes.
    pub thrust_body: Unit<Vector3<f64>>,
}

impl Mounting {
    /// `theta_config` \[rad\].
    #[must_use]
    pub fn angle_rad(&self) -> f64 {
        self.boresight_body.angle(&self.thrust_body)
    }
}

/// An attitude and what it leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pointing {
    /// `v_eci = q * v_body`.
    pub q_eci_body: UnitQuaternion<f64>,
    /// `theta_mission` \[rad\]; NaN without a wanted velocity change.
    pub mission_angle_rad: f64,
    /// Angle between the boresight and the target \[rad\].
    pub boresight_error_rad: f64,
    /// Angle between the thrust and the wanted velocity change \[rad\]; NaN without one.
    pub thrust_error_rad: f64,
}

/// The attitude that shares the mismatch by `thrust_weight` (0: boresight exact, 1: thrust exact).
///
/// Without a wanted velocity change (or one along the line of sight, which leaves the roll free) the thrust is
/// turned towards `otherwise_eci`, for example the direction of flight.
#[must_use]
pub fn pointing(
    mounting: &Mounting,
    line_of_sight_eci: &Vector3<f64>,
    delta_v_eci_m_s: &Vector3<f64>,
    otherwise_eci: &Vector3<f64>,
    thrust_weight: f64,
) -> Pointing {
    let sight = unit_or(line_of_sight_eci, &Vector3::x());
    let wanted = delta_v_eci_m_s.norm() > NO_DELTA_V_M_S;
    let thrust =
        if wanted { unit_or(delta_v_eci_m_s, &Vector3::y()) } else { unit_or(otherwise_eci, &Vector3::y()) };
    let mission = sight.angle(&thrust);
    let config = mounting.angle_rad();
    // The plane's normal; with parallel directions any plane through them.
    let in_plane = if mission > PARALLEL_RAD && mission < std::f64::consts::PI - PARALLEL_RAD {
        sight.cross(&thrust)
    } else {
        sight.cross(&unit_or(otherwise_eci, &Vector3::y()))
    };
    let normal = unit_or(&in_plane, &any_normal(&sight));
    let body_plane = mounting.boresight_body.cross(&mounting.thrust_body);
    let body_normal = unit_or(&body_plane, &any_normal(&mounting.boresight_body));

    // Boresight exact and the thruster in the plane, on the side of the wanted direction ...
    let frame = |first: &Vector3<f64>, normal: &Vector3<f64>| {
        Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[*first, normal.cross(first), *normal]))
    };
    let exact = frame(&sight, &normal) * frame(&mounting.boresight_body, &body_normal).inverse();
    // ... then turned in the plane by its share of the mismatch.
    let share = if wanted { thrust_weight.clamp(0.0, 1.0) * (mission - config) } else { 0.0 };
    let turned = Rotation3::from_axis_angle(&Unit::new_unchecked(normal), share) * exact;
    let q_eci_body = UnitQuaternion::from_rotation_matrix(&turned);
    let boresight_error_rad = (q_eci_body * mounting.boresight_body.into_inner()).angle(&sight);
    let thrust_error = (q_eci_body * mounting.thrust_body.into_inner()).angle(&thrust);
    Pointing {
        q_eci_body,
        mission_angle_rad: if wanted { mission } else { f64::NAN },
        boresight_error_rad,
        thrust_error_rad: if wanted { thrust_error } else { f64::NAN },
    }
}

fn unit_or(vector: &Vector3<f64>, otherwise: &Vector3<f64>) -> Vector3<f64> {
    Unit::try_new(*vector, 1e-12).map_or(*otherwise, Unit::into_inner)
}

fn any_normal(axis: &Vector3<f64>) -> Vector3<f64> {
    let other = if axis.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    unit_or(&axis.cross(&other), &Vector3::y())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EARTH_RADIUS_M;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0..1.0_f64)
            .prop_map(Vector3::from)
            .prop_filter("not zero", |v| v.norm() > 0.1)
    }

    fn mounting(boresight: Vector3<f64>, thrust: Vector3<f64>) -> Mounting {
        Mounting { boresight_body: Unit::new_normalize(boresight), thrust_body: Unit::new_normalize(thrust) }
    }

    proptest! {
        #[test]
        fn the_mismatch_is_shared_by_the_weight(
            sight in direction(), dv in direction(), boresight in direction(), thrust in direction(), w in 0.0..1.0_f64,
        ) {
            let mounting = mounting(boresight, thrust);
            let mission = sight.angle(&dv);
            prop_assume!(mission > 0.05 && mission < 3.09);
            prop_assume!(mounting.angle_rad() > 0.05 && mounting.angle_rad() < 3.09);
            let p = pointing(&mounting, &sight, &dv, &Vector3::z(), w);
            let mismatch = (mission - mounting.angle_rad()).abs();
            prop_assert!((p.boresight_error_rad - w * mismatch).abs() < 1e-6);
            prop_assert!((p.thrust_error_rad - (1.0 - w) * mismatch).abs() < 1e-6);
            // No attitude has a lower weighted cost: turned a little about any axis it grows.
            let cost = |q: UnitQuaternion<f64>| {
                let b = (q * mounting.boresight_body.into_inner()).angle(&sight);
                let t = (q * mounting.thrust_body.into_inner()).angle(&dv);
                (1.0 - w) * b * b + w * t * t
            };
            let best = cost(p.q_eci_body);
            for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
                for angle in [-1e-3, 1e-3] {
                    prop_assert!(cost(UnitQuaternion::from_axis_angle(&axis, angle) * p.q_eci_body) >= best - 1e-9);
                }
            }
        }
    }

    #[test]
    fn without_a_wanted_velocity_change_the_boresight_is_exact() {
        let p = pointing(
            &mounting(Vector3::x(), Vector3::y()),
            &-Vector3::x(),
            &Vector3::zeros(),
            &Vector3::y(),
            0.7,
        );
        assert!(p.boresight_error_rad < 1e-9 && p.mission_angle_rad.is_nan());
        assert!((p.q_eci_body * Vector3::y()).angle(&Vector3::y()) < 1e-9);
    }

    #[test]
    fn the_centroid_lies_between_and_a_point_turns_with_the_earth() {
        let pair = [Vector3::new(7e6, 1e5, 0.0), Vector3::new(7e6, -1e5, 0.0)];
        let centroid = Target::Centroid.position_m(&pair, 0.0).unwrap();
        assert!((centroid - Vector3::new(EARTH_RADIUS_M, 0.0, 0.0)).norm() < 1e-6);
        let opposite = [Vector3::x() * 7e6, -Vector3::x() * 7e6];
        assert_eq!(Target::Centroid.position_m(&opposite, 0.0), Err(TargetError::NoCentroid));
        // The two latitudes of a number: 0.192 deg or 21 km on the ground at 45 deg.
        let mapped = Target::geodetic(45_f64.to_radians(), 0.0).position_m(&[], 0.0).unwrap();
        let central = Target::Point { latitude_rad: 45_f64.to_radians(), longitude_rad: 0.0 };
        let apart_m = (mapped - central.position_m(&[], 0.0).unwrap()).norm();
        assert!((apart_m - 21.4e3).abs() < 100.0, "{apart_m}");
        let point = Target::Point { latitude_rad: 0.0, longitude_rad: 0.1 };
        let later = point.position_m(&[], 86164.0905 / 4.0).unwrap();
        assert!((later.y.atan2(later.x) - 0.1 - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        assert!(
            (elevation_rad(&centroid, &Vector3::new(7e6, 0.0, 0.0)) - std::f64::consts::FRAC_PI_2).abs()
                < 1e-9
        );
    }
}
