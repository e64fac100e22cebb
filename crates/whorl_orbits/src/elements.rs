//! Classical orbital elements of an ellipse.
//!
//! Source: H. Schaub, J. L. Junkins, *Analytical Mechanics of Space Systems*, chapter 9.

use nalgebra::{Rotation3, Vector3};
use thiserror::Error;
use whorl_math::wrap_angle_rad;

use crate::orbit_state::OrbitState;
use crate::{EARTH_MU_M3_S2, EARTH_RADIUS_M};

/// Newton iterations on Kepler's equation; it converges in fewer than 10 for every e below 0.99.
const KEPLER_STEPS: usize = 50;

/// Classical elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elements {
    /// Semi-major axis \[m\], > 0.
    pub semi_major_axis_m: f64,
    /// Eccentricity, 0 to below 1.
    pub eccentricity: f64,
    /// Inclination \[rad\], 0 to pi.
    pub inclination_rad: f64,
    /// Right ascension of the ascending node \[rad\].
    pub node_rad: f64,
    /// Argument of perigee \[rad\].
    pub perigee_rad: f64,
    /// Mean anomaly \[rad\].
    pub mean_anomaly_rad: f64,
}

/// An invalid orbit.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum OrbitError {
    /// It meets the ground.
    #[error(
        "the orbit's lowest point is {altitude_m:.0} m above the ground: at least {least_m:.0} m is needed"
    )]
    Ground {
        /// Lowest altitude above the equatorial radius \[m\].
        altitude_m: f64,
        /// The least that is allowed \[m\].
        least_m: f64,
    },
    /// It is no ellipse.
    #[error("eccentricity {eccentricity}: only ellipses (0 to below 1) return")]
    NotElliptic {
        /// As given.
        eccentricity: f64,
    },
    /// A number is not finite, or the semi-major axis not positive.
    #[error("{name} = {value} is not valid for an orbit")]
    Number {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
    },
}

/// Orbits below this decay within days \[m\].
const LEAST_ALTITUDE_M: f64 = 100e3;

impl Elements {
    /// Refuses invalid orbits, and those that meet the ground or the dense atmosphere.
    ///
    /// # Errors
    /// What is wrong and what is allowed.
    pub fn check(&self) -> Result<(), OrbitError> {
        for (name, value) in [
            ("the semi-major axis [m]", self.semi_major_axis_m),
            ("the inclination [rad]", self.inclination_rad),
            ("the node [rad]", self.node_rad),
            ("the argument of perigee [rad]", self.perigee_rad),
            ("the mean anomaly [rad]", self.mean_anomaly_rad),
        ] {
            if !value.is_finite() {
                return Err(OrbitError::Number { name, value });
            }
        }
        if !(0.0..1.0).contains(&self.eccentricity) {
            return Err(OrbitError::NotElliptic { eccentricity: self.eccentricity });
        }
        if self.semi_major_axis_m <= 0.0 {
            return Err(OrbitError::Number {
                name: "the semi-major axis [m]",
                value: self.semi_major_axis_m,
            });
        }
        let altitude_m = self.semi_major_axis_m * (1.0 - self.eccentricity) - EARTH_RADIUS_M;
        if altitude_m < LEAST_ALTITUDE_M {
            return Err(OrbitError::Ground { altitude_m, least_m: LEAST_ALTITUDE_M });
        }
        Ok(())
    }

    /// Mean motion \[rad/s\].
    #[must_use]
    pub fn mean_motion_rad_s(&self) -> f64 {
        (EARTH_MU_M3_S2 / self.semi_major_axis_m.powi(3)).sqrt()
    }

    /// Time of one revolution \[s\].
    #[must_use]
    pub fn period_s(&self) -> f64 {
        std::f64::consts::TAU / self.mean_motion_rad_s()
    }

    /// Semi-latus rectum \[m\].
    #[must_use]
    pub fn parameter_m(&self) -> f64 {
        self.semi_major_axis_m * (1.0 - self.eccentricity * self.eccentricity)
    }

    /// Eccentric anomaly \[rad\]: Kepler's equation `M = E - e sin E`.
    #[must_use]
    pub fn eccentric_anomaly_rad(&self) -> f64 {
        let (m, e) = (wrap_angle_rad(self.mean_anomaly_rad), self.eccentricity);
        let mut anomaly = if e < 0.8 { m } else { std::f64::consts::PI.copysign(m) };
        for _ in 0..KEPLER_STEPS {
            let step = (anomaly - e * anomaly.sin() - m) / (1.0 - e * anomaly.cos());
            anomaly -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        anomaly
    }

    /// True anomaly \[rad\].
    #[must_use]
    pub fn true_anomaly_rad(&self) -> f64 {
        let half = 0.5 * self.eccentric_anomaly_rad();
        let ratio = ((1.0 + self.eccentricity) / (1.0 - self.eccentricity)).sqrt();
        2.0 * (ratio * half.sin()).atan2(half.cos())
    }

    /// Mean anomaly that belongs to a true anomaly \[rad\].
    #[must_use]
    pub fn mean_from_true_rad(eccentricity: f64, true_anomaly_rad: f64) -> f64 {
        let half = 0.5 * true_anomaly_rad;
        let ratio = ((1.0 - eccentricity) / (1.0 + eccentricity)).sqrt();
        let anomaly = 2.0 * (ratio * half.sin()).atan2(half.cos());
        anomaly - eccentricity * anomaly.sin()
    }

    /// The same orbit `dt_s` later, without perturbations.
    #[must_use]
    pub fn after(&self, dt_s: f64) -> Self {
        let mean_anomaly_rad = self.mean_anomaly_rad + self.mean_motion_rad_s() * dt_s;
        Self { mean_anomaly_rad, ..*self }
    }

    /// Position and velocity, inertial axes.
    #[must_use]
    pub fn state(&self) -> OrbitState {
        let (sine, cosine) = self.true_anomaly_rad().sin_cos();
        let p = self.parameter_m();
        let speed = (EARTH_MU_M3_S2 / p).sqrt();
        let to_eci = Rotation3::from_axis_angle(&Vector3::z_axis(), self.node_rad)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), self.inclination_rad)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), self.perigee_rad);
        OrbitState {
            position_m: to_eci * Vector3::new(cosine, sine, 0.0) * (p / (1.0 + self.eccentricity * cosine)),
            velocity_m_s: to_eci * Vector3::new(-sine, self.eccentricity + cosine, 0.0) * speed,
        }
    }

    /// Elements of a state. On an equator or a circle, where node or perigee are undefined, they are 0 and
    /// the other angles count from there.
    ///
    /// # Errors
    /// A state that is not on an ellipse.
    pub fn of(state: &OrbitState) -> Result<Self, OrbitError> {
        let (r, v) = (state.position_m, state.velocity_m_s);
        let radius = r.norm();
        let energy = 0.5 * v.norm_squared() - EARTH_MU_M3_S2 / radius;
        let semi_major_axis_m = -0.5 * EARTH_MU_M3_S2 / energy;
        if !(semi_major_axis_m > 0.0 && semi_major_axis_m.is_finite()) {
            return Err(OrbitError::Number { name: "the semi-major axis [m]", value: semi_major_axis_m });
        }
        let h = r.cross(&v);
        let perigee = v.cross(&h) / EARTH_MU_M3_S2 - r / radius;
        let eccentricity = perigee.norm();
        if eccentricity >= 1.0 {
            return Err(OrbitError::NotElliptic { eccentricity });
        }
        let normal = h / h.norm();
        let node_axis = Vector3::z().cross(&normal);
        let node = if node_axis.norm() > 1e-12 { node_axis / node_axis.norm() } else { Vector3::x() };
        // Angles in the orbit's plane, from the node.
        let in_plane = |x: &Vector3<f64>| normal.cross(&node).dot(x).atan2(node.dot(x));
        let latitude_rad = in_plane(&r);
        let perigee_rad = if eccentricity > 1e-12 { in_plane(&perigee) } else { 0.0 };
        Ok(Self {
            semi_major_axis_m,
            eccentricity,
            inclination_rad: h.x.hypot(h.y).atan2(h.z),
            node_rad: node.y.atan2(node.x),
            perigee_rad,
            mean_anomaly_rad: Self::mean_from_true_rad(eccentricity, latitude_rad - perigee_rad),
        })
    }
}

/// A chief for tests, 500 km above the ground at its perigee.
#[cfg(test)]
pub(crate) fn test_chief(eccentricity: f64, mean_anomaly_rad: f64) -> Elements {
    Elements {
        semi_major_axis_m: (crate::EARTH_RADIUS_M + 500e3) / (1.0 - eccentricity),
        eccentricity,
        inclination_rad: 0.9,
        node_rad: 0.3,
        perigee_rad: 0.5,
        mean_anomaly_rad,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn printed_example_of_a_state_is_met() {
        // D. A. Vallado, Fundamentals of Astrodynamics and Applications, 4th ed., example 2-5: r and v in km.
        let state = OrbitState {
            position_m: Vector3::new(6524.834, 6862.875, 6448.296) * 1e3,
            velocity_m_s: Vector3::new(4.901327, 5.533756, -1.976341) * 1e3,
        };
        let e = Elements::of(&state).unwrap();
        assert!((e.semi_major_axis_m / 36127.343e3 - 1.0).abs() < 1e-6, "{}", e.semi_major_axis_m);
        assert!((e.eccentricity - 0.832853).abs() < 1e-6);
        assert!((e.inclination_rad.to_degrees() - 87.870).abs() < 1e-3);
        assert!((e.node_rad.to_degrees().rem_euclid(360.0) - 227.898).abs() < 1e-3);
        assert!((e.perigee_rad.to_degrees().rem_euclid(360.0) - 53.38).abs() < 1e-2);
        assert!((e.true_anomaly_rad().to_degrees().rem_euclid(360.0) - 92.335).abs() < 1e-3);
    }

    proptest! {
        #[test]
        fn states_and_elements_are_the_same_thing(
            altitude in 200e3..36e6_f64,
            eccentricity in 0.0..0.9_f64,
            inclination_rad in 0.01..3.1_f64,
            angles in prop::array::uniform3(-3.1..3.1_f64),
        ) {
            let semi_major_axis_m = (EARTH_RADIUS_M + altitude) / (1.0 - eccentricity);
            let [node_rad, perigee_rad, mean_anomaly_rad] = angles;
            let elements = Elements { semi_major_axis_m, eccentricity, inclination_rad, node_rad, perigee_rad, mean_anomaly_rad };
            let state = elements.state();
            let back = Elements::of(&state).unwrap().state();
            prop_assert!((back.position_m - state.position_m).norm() < 1e-6 * state.position_m.norm());
            prop_assert!((back.velocity_m_s - state.velocity_m_s).norm() < 1e-6 * state.velocity_m_s.norm());
        }
    }

    #[test]
    fn orbits_that_cannot_be_are_refused_in_words() {
        let low = Elements {
            semi_major_axis_m: EARTH_RADIUS_M + 50e3,
            eccentricity: 0.0,
            inclination_rad: 0.9,
            node_rad: 0.0,
            perigee_rad: 0.0,
            mean_anomaly_rad: 0.0,
        };
        assert!(low.check().unwrap_err().to_string().contains("50000 m above the ground"));
        let dives = Elements { semi_major_axis_m: 8e6, eccentricity: 0.3, ..low };
        assert!(dives.check().unwrap_err().to_string().contains("-"));
        assert!(Elements { eccentricity: 1.2, ..low }.check().is_err());
        assert!(Elements { node_rad: f64::NAN, ..low }.check().is_err());
        assert!(Elements { semi_major_axis_m: 7e6, ..low }.check().is_ok());
    }
}
