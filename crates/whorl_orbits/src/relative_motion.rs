//! Full nonlinear motion of a deputy relative to a chief on any unperturbed orbit (2.18)-(2.20).
//!
//! The chief's radius and anomaly are carried along with (2.12) and (2.15):
//!
//! ```text
//! x'' = 2 nu' (y' - y rc'/rc) + x nu'^2 + mu/rc^2 - mu/rd^3 (rc + x)
//! y'' = -2 nu' (x' - x rc'/rc) + y nu'^2 - mu/rd^3 y
//! z'' = -mu/rd^3 z
//! rc'' = rc nu'^2 - mu/rc^2,   nu'' = -2 rc'/rc nu'
//! ```

use nalgebra::{SVector, Vector3};

use crate::EARTH_MU_M3_S2;
use crate::hill::{HillState, anomaly_rate_rad_s};
use crate::orbit_state::OrbitState;
use crate::runge_kutta::integrate;

/// Longest step \[s\].
const STEP_S: f64 = 5.0;

/// The deputy `t_s` later, seen from the chief, which was at `chief`.
#[must_use]
pub fn after(chief: &OrbitState, deputy: &HillState, t_s: f64) -> HillState {
    let radius = chief.position_m.norm();
    let (p, v) = (deputy.position_m, deputy.velocity_m_s);
    let radial_rate = chief.position_m.dot(&chief.velocity_m_s) / radius;
    let rate = anomaly_rate_rad_s(chief);
    let start = SVector::<f64, 9>::from([p.x, p.y, p.z, v.x, v.y, v.z, radius, radial_rate, rate]);
    let end = integrate(start, t_s, STEP_S, derivative);
    HillState {
        position_m: Vector3::new(end[0], end[1], end[2]),
        velocity_m_s: Vector3::new(end[3], end[4], end[5]),
    }
}

fn derivative(q: &SVector<f64, 9>) -> SVector<f64, 9> {
    let (x, y, z) = (q[0], q[1], q[2]);
    let (vx, vy, vz) = (q[3], q[4], q[5]);
    let (rc, rc_dot, nu_dot) = (q[6], q[7], q[8]);
    let rd = ((rc + x).powi(2) + y * y + z * z).sqrt();
    let (at_chief, at_deputy) = (EARTH_MU_M3_S2 / (rc * rc), EARTH_MU_M3_S2 / rd.powi(3));
    let shrinking = rc_dot / rc;
    SVector::<f64, 9>::from([
        vx,
        vy,
        vz,
        2.0 * nu_dot * (vy - y * shrinking) + x * nu_dot * nu_dot + at_chief - at_deputy * (rc + x),
        -2.0 * nu_dot * (vx - x * shrinking) + y * nu_dot * nu_dot - at_deputy * y,
        -at_deputy * z,
        rc_dot,
        rc * nu_dot * nu_dot - at_chief,
        -2.0 * shrinking * nu_dot,
    ])
}
