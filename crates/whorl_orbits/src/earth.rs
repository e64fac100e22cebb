//! The Earth's figure: the ellipsoid of WGS 84, and the two latitudes of a point on it.
//!
//! *Geodetic* latitude, that of maps and of satellite navigation, is the angle of the ellipsoid's normal to the equator;
//! *geocentric* latitude is that of the line from the Earth's centre. `tan(geocentric) = (1 - f)^2 tan(geodetic)`: they
//! differ by up to 0.192 degrees, 21 km on the ground, at 45 degrees.
//!
//! Source: National Geospatial-Intelligence Agency, *World Geodetic System 1984*, NGA.STND.0036, 2014, chapter 4;
//! B. R. Bowring, "Transformation from spatial to geographical coordinates", Survey Review 23, 1976.

use nalgebra::{Unit, Vector3};

use crate::EARTH_RADIUS_M;

/// Flattening of the Earth (WGS 84).
pub const EARTH_FLATTENING: f64 = 1.0 / 298.257_223_563;

/// A point of the ellipsoid by its geodetic latitude and longitude \[rad\], Earth-fixed axes \[m\].
#[must_use]
pub fn surface_geodetic_m(latitude_rad: f64, longitude_rad: f64) -> Vector3<f64> {
    let (sine, cosine) = latitude_rad.sin_cos();
    let squeeze = (1.0 - EARTH_FLATTENING).powi(2);
    // Radius of curvature in the prime vertical.
    let normal_m = EARTH_RADIUS_M / (cosine * cosine + squeeze * sine * sine).sqrt();
    Vector3::new(cosine * longitude_rad.cos(), cosine * longitude_rad.sin(), squeeze * sine) * normal_m
}

/// The same by its geocentric latitude.
#[must_use]
pub fn surface_geocentric_m(latitude_rad: f64, longitude_rad: f64) -> Vector3<f64> {
    surface_geodetic_m(geodetic_from_geocentric_rad(latitude_rad), longitude_rad)
}

/// Geodetic latitude of a point of the surface with this geocentric one \[rad\].
#[must_use]
pub fn geodetic_from_geocentric_rad(geocentric_rad: f64) -> f64 {
    let (sine, cosine) = geocentric_rad.sin_cos();
    sine.atan2(cosine * (1.0 - EARTH_FLATTENING).powi(2))
}

/// Geocentric latitude of a point of the surface with this geodetic one \[rad\].
#[must_use]
pub fn geocentric_from_geodetic_rad(geodetic_rad: f64) -> f64 {
    let (sine, cosine) = geodetic_rad.sin_cos();
    (sine * (1.0 - EARTH_FLATTENING).powi(2)).atan2(cosine)
}

/// Upwards at a point of the surface: the ellipsoid's normal. The pole's at the centre, where there is none.
#[must_use]
pub fn up(surface_m: &Vector3<f64>) -> Unit<Vector3<f64>> {
    let squeeze = (1.0 - EARTH_FLATTENING).powi(2);
    let normal = Vector3::new(surface_m.x, surface_m.y, surface_m.z / squeeze);
    Unit::try_new(normal, 1e-3).unwrap_or_else(Vector3::z_axis)
}

/// The point of the surface straight below a spacecraft, where the spacecraft stands in the zenith, same axes \[m\].
///
/// Bowring's iteration for the parametric latitude; twice gives better than a micrometre up to geostationary heights.
#[must_use]
pub fn below_m(position_m: &Vector3<f64>) -> Vector3<f64> {
    let (radius_m, polar_m) = (EARTH_RADIUS_M, EARTH_RADIUS_M * (1.0 - EARTH_FLATTENING));
    let eccentricity2 = EARTH_FLATTENING * (2.0 - EARTH_FLATTENING);
    let second2 = eccentricity2 / (1.0 - eccentricity2);
    let across_m = position_m.x.hypot(position_m.y);
    let mut parametric_rad = (position_m.z * radius_m).atan2(across_m * polar_m);
    let mut latitude_rad = 0.0;
    for _ in 0..2 {
        let (sine, cosine) = parametric_rad.sin_cos();
        latitude_rad = (position_m.z + second2 * polar_m * sine.powi(3))
            .atan2(across_m - eccentricity2 * radius_m * cosine.powi(3));
        parametric_rad = ((1.0 - EARTH_FLATTENING) * latitude_rad.sin()).atan2(latitude_rad.cos());
    }
    surface_geodetic_m(latitude_rad, position_m.y.atan2(position_m.x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_point_below_has_the_spacecraft_in_its_zenith(
            latitude in -1.57..1.57_f64, longitude in -3.1..3.1_f64, height in 0.0..4e7_f64,
        ) {
            let surface = surface_geodetic_m(latitude, longitude);
            let spacecraft = surface + up(&surface).into_inner() * height;
            prop_assert!((below_m(&spacecraft) - surface).norm() < 1e-5);
            // On the ellipsoid, by its equation.
            let polar = EARTH_RADIUS_M * (1.0 - EARTH_FLATTENING);
            let form = surface.xy().norm_squared() / EARTH_RADIUS_M.powi(2) + (surface.z / polar).powi(2);
            prop_assert!((form - 1.0).abs() < 1e-12);
            let geocentric = surface.z.atan2(surface.xy().norm());
            prop_assert!((geocentric_from_geodetic_rad(latitude) - geocentric).abs() < 1e-12);
            prop_assert!((geodetic_from_geocentric_rad(geocentric) - latitude).abs() < 1e-12);
        }
    }

    #[test]
    fn the_poles_have_no_longitude_and_do_no_harm() {
        let below = below_m(&Vector3::new(0.0, 0.0, -7e6));
        assert!((below - Vector3::new(0.0, 0.0, -6_356_752.314_245)).norm() < 1e-5, "{below}");
    }
}
