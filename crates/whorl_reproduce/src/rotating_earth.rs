//! The rotating Earth: Newtonian and Lagrangian derivation (eqs. 4.15-4.38).
//!
//! [`external_torque_b_n_m`] is eq. 4.25. The tests of this module derive the same torque from Lagrange's
//! equations with the kinetic energy of eq. 4.29 and numerical derivatives: two derivations that share
//! nothing but the energy. Found on the way:
//!
//! - three of the six terms in the bracket of eq. 4.25, those with the first moment c_b, cancel for every
//!   motion (Jacobi's identity): c x (v x w) - (c x v) x w - v x (c x w) = 0;
//! - the two c_b terms of the last line join to c x (Omega x v): the centrifugal part of gravity, which a
//!   plumb line has in its direction already;
//! - eq. 4.28 lacks the coupling term that eq. 4.29 has, and eq. 4.29 drops the constant m v^2 / 2;
//!   c_b is the first moment of mass, not "mass moment of inertia".

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use whorl_math::skew;

/// Sidereal rate of the Earth [rad/s].
pub const EARTH_RATE_RAD_S: f64 = 7.292_115e-5;
/// Mean radius of the Earth \[m\].
pub const EARTH_RADIUS_M: f64 = 6.371e6;
/// Latitude of Blacksburg \[rad\] (section 4.3.1: 37.21 deg north).
pub const BLACKSBURG_RAD: f64 = 0.649_437;

/// A laboratory on the rotating Earth, axes east, north, up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laboratory {
    /// Rate of the Earth, local axes [rad/s] (eq. 4.16, there in south, east, zenith).
    pub rate_l_rad_s: Vector3<f64>,
    /// Velocity of the laboratory, local axes [m/s] (eq. 4.17).
    pub velocity_l_m_s: Vector3<f64>,
}

impl Laboratory {
    /// At this latitude \[rad\].
    #[must_use]
    pub fn at_latitude(latitude_rad: f64) -> Self {
        let rate = Vector3::new(0.0, latitude_rad.cos(), latitude_rad.sin()) * EARTH_RATE_RAD_S;
        Self { rate_l_rad_s: rate, velocity_l_m_s: rate.cross(&(Vector3::z() * EARTH_RADIUS_M)) }
    }
}

/// A body on its bearing: inertia about the centre of rotation and first moment of mass, body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// [kg m^2]
    pub inertia_b_kg_m2: Matrix3<f64>,
    /// c_b, mass times position of its centre [kg m].
    pub first_moment_b_kg_m: Vector3<f64>,
}

/// Eq. 4.25, term by term as printed: the torque, gravity included, that this motion against the
/// laboratory needs [N m]. `q_local_body` turns body into local axes; rates are seen from the laboratory.
#[must_use]
pub fn external_torque_b_n_m(
    body: &Body,
    laboratory: &Laboratory,
    q_local_body: &UnitQuaternion<f64>,
    omega_b_rad_s: &Vector3<f64>,
    omega_dot_b_rad_s2: &Vector3<f64>,
) -> Vector3<f64> {
    let (i, c) = (body.inertia_b_kg_m2, skew(&body.first_moment_b_kg_m));
    let earth = q_local_body.inverse_transform_vector(&laboratory.rate_l_rad_s);
    let velocity = q_local_body.inverse_transform_vector(&laboratory.velocity_l_m_s);
    let (w, e, v) = (skew(omega_b_rad_s), skew(&earth), skew(&velocity));
    let bracket = c * v + i * e + e * i - skew(&(c * velocity)) - skew(&(i * earth)) - v * c;
    i * omega_dot_b_rad_s2 + w * i * omega_b_rad_s + bracket * omega_b_rad_s - v * c * earth
        + e * c * velocity
        + e * i * earth
}

/// What eq. 4.25 adds to Euler's equations [N m]; `plumb_line` leaves out the centrifugal part, which is
/// in the direction of the plumb line already.
#[must_use]
pub fn perturbation_b_n_m(
    body: &Body,
    laboratory: &Laboratory,
    q_local_body: &UnitQuaternion<f64>,
    omega_b_rad_s: &Vector3<f64>,
    plumb_line: bool,
) -> Vector3<f64> {
    let zero = Vector3::zeros();
    let whole = external_torque_b_n_m(body, laboratory, q_local_body, omega_b_rad_s, &zero);
    let euler = omega_b_rad_s.cross(&(body.inertia_b_kg_m2 * omega_b_rad_s));
    let centrifugal = body.first_moment_b_kg_m.cross(
        &q_local_body.inverse_transform_vector(&laboratory.rate_l_rad_s.cross(&laboratory.velocity_l_m_s)),
    );
    whole - euler - if plumb_line { centrifugal } else { zero }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body() -> Body {
        Body {
            inertia_b_kg_m2: Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1),
            first_moment_b_kg_m: Vector3::new(0.05, -0.12, -0.2),
        }
    }

    /// Roll, pitch, yaw over time, and their rates.
    fn angles(t: f64) -> [Vector3<f64>; 2] {
        [
            Vector3::new(0.3 * (0.7 * t).sin(), 0.5 * (0.9 * t).cos(), 0.8 * t + 0.2 * (0.4 * t).sin()),
            Vector3::new(0.21 * (0.7 * t).cos(), -0.45 * (0.9 * t).sin(), 0.8 + 0.08 * (0.4 * t).cos()),
        ]
    }

    fn attitude(angles: &Vector3<f64>) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(angles.x, angles.y, angles.z)
    }

    /// w = S(theta) dtheta/dt for yaw, pitch, roll.
    fn s_matrix(angles: &Vector3<f64>) -> Matrix3<f64> {
        let ((sr, cr), (sp, cp)) = (angles.x.sin_cos(), angles.y.sin_cos());
        Matrix3::new(1.0, 0.0, -sp, 0.0, cr, sr * cp, 0.0, -sr, cr * cp)
    }

    /// Eq. 4.29.
    fn kinetic_energy(angles: &Vector3<f64>, rates: &Vector3<f64>, lab: &Laboratory) -> f64 {
        let q = attitude(angles);
        let omega = s_matrix(angles) * rates + q.inverse_transform_vector(&lab.rate_l_rad_s);
        let velocity = q.inverse_transform_vector(&lab.velocity_l_m_s);
        omega.dot(&body().first_moment_b_kg_m.cross(&velocity))
            + 0.5 * omega.dot(&(body().inertia_b_kg_m2 * omega))
    }

    /// Lagrange's equations (4.26) with numerical derivatives, generalised force S^T g (4.33).
    #[test]
    fn newton_and_lagrange_agree() {
        // A fast Earth, so that every term of it counts.
        let mut lab = Laboratory::at_latitude(BLACKSBURG_RAD);
        lab.rate_l_rad_s *= 1000.0;
        lab.velocity_l_m_s = lab.rate_l_rad_s.cross(&Vector3::new(0.0, 0.0, 50.0));
        for t in [0.3, 1.9, 4.4] {
            let h = 1e-4;
            let partial = |f: &dyn Fn(f64) -> f64| (f(h) - f(-h)) / (2.0 * h);
            let momentum = |t: f64, n: usize| {
                let [a, r] = angles(t);
                partial(&|d| kinetic_energy(&a, &(r + Vector3::ith(n, d)), &lab))
            };
            let generalised = Vector3::from_fn(|n, _| {
                let [a, r] = angles(t);
                let rate = (momentum(t + h, n) - momentum(t - h, n)) / (2.0 * h);
                rate - partial(&|d| kinetic_energy(&(a + Vector3::ith(n, d)), &r, &lab))
            });
            let omega = |t: f64| {
                let [a, r] = angles(t);
                s_matrix(&a) * r
            };
            let q = attitude(&angles(t)[0]);
            let omega_dot = (omega(t + h) - omega(t - h)) / (2.0 * h);
            let torque = external_torque_b_n_m(&body(), &lab, &q, &omega(t), &omega_dot);
            let newton = s_matrix(&angles(t)[0]).transpose() * torque;
            assert!((newton - generalised).norm() < 2e-5, "{newton} {generalised}");
            assert!(newton.norm() > 1.0);
        }
    }

    #[test]
    fn the_first_moment_cancels_from_the_bracket() {
        let (c, v, w) =
            (Vector3::new(0.1, -0.2, 0.3), Vector3::new(370.0, 5.0, -3.0), Vector3::new(0.2, 0.4, -1.0));
        let sum = c.cross(&v.cross(&w)) - c.cross(&v).cross(&w) - v.cross(&c.cross(&w));
        assert!(sum.norm() < 1e-12);
    }
}
