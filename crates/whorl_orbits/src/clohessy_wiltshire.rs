//! Motion relative to a chief on a circle, linearised (2.25)-(2.34).
//!
//! Source: Schwartz 2004, section 2.1.3; W. H. Clohessy, R. S. Wiltshire, J. Aerospace Sciences 27(9), 1960.
//! Assumptions: circular chief, separations small against its radius, no perturbations.

use nalgebra::{SVector, Vector3};

use crate::hill::HillState;
use crate::runge_kutta::integrate;

/// Steps of the numerical solution in a revolution.
const STEPS_PER_REVOLUTION: f64 = 2000.0;

/// (2.28)-(2.30): the state `t_s` later, for a chief with mean motion `n`.
#[must_use]
pub fn closed_form(state: &HillState, n_rad_s: f64, t_s: f64) -> HillState {
    let n = n_rad_s;
    let (s, c) = (n * t_s).sin_cos();
    let (x0, y0, z0) = (state.position_m.x, state.position_m.y, state.position_m.z);
    let (vx, vy, vz) = (state.velocity_m_s.x, state.velocity_m_s.y, state.velocity_m_s.z);
    HillState {
        position_m: Vector3::new(
            vx / n * s - (3.0 * x0 + 2.0 * vy / n) * c + 4.0 * x0 + 2.0 * vy / n,
            2.0 * vx / n * c + (6.0 * x0 + 4.0 * vy / n) * s - (6.0 * n * x0 + 3.0 * vy) * t_s - 2.0 * vx / n
                + y0,
            vz / n * s + z0 * c,
        ),
        velocity_m_s: Vector3::new(
            vx * c + (3.0 * n * x0 + 2.0 * vy) * s,
            -2.0 * vx * s + (6.0 * n * x0 + 4.0 * vy) * c - (6.0 * n * x0 + 3.0 * vy),
            vz * c - n * z0 * s,
        ),
    }
}

/// (2.32)-(2.34): the position `t_s` later of a state without drift, `vy = -2 n x` (2.31). What `vy` is
/// is not looked at.
#[must_use]
pub fn driftless_position_m(state: &HillState, n_rad_s: f64, t_s: f64) -> Vector3<f64> {
    let n = n_rad_s;
    let (s, c) = (n * t_s).sin_cos();
    let (x0, y0, z0) = (state.position_m.x, state.position_m.y, state.position_m.z);
    let (vx, vz) = (state.velocity_m_s.x, state.velocity_m_s.z);
    Vector3::new(
        vx / n * s + x0 * c,
        2.0 * vx / n * c - 2.0 * x0 * s - 2.0 * vx / n + y0,
        vz / n * s + z0 * c,
    )
}

/// (2.31): the state with the in-track velocity that does not drift.
#[must_use]
pub fn driftless(state: &HillState, n_rad_s: f64) -> HillState {
    let mut driftless = *state;
    driftless.velocity_m_s.y = -2.0 * n_rad_s * state.position_m.x;
    driftless
}

/// (2.25)-(2.27), integrated numerically.
#[must_use]
pub fn numerical(state: &HillState, n_rad_s: f64, t_s: f64) -> HillState {
    let n = n_rad_s;
    let step_s = std::f64::consts::TAU / n / STEPS_PER_REVOLUTION;
    let (p, v) = (state.position_m, state.velocity_m_s);
    let start = SVector::<f64, 6>::from([p.x, p.y, p.z, v.x, v.y, v.z]);
    let end = integrate(start, t_s, step_s, |q| {
        SVector::<f64, 6>::from([
            q[3],
            q[4],
            q[5],
            2.0 * n * q[4] + 3.0 * n * n * q[0],
            -2.0 * n * q[3],
            -n * n * q[2],
        ])
    });
    HillState {
        position_m: Vector3::new(end[0], end[1], end[2]),
        velocity_m_s: Vector3::new(end[3], end[4], end[5]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn closed_form_solves_the_equations(
            p in prop::array::uniform3(-1000.0..1000.0_f64),
            v in prop::array::uniform3(-1.0..1.0_f64),
            revolutions in 0.0..2.0_f64,
        ) {
            let n = 1.1e-3;
            let state = HillState { position_m: p.into(), velocity_m_s: v.into() };
            let t = revolutions * std::f64::consts::TAU / n;
            let (a, b) = (closed_form(&state, n, t), numerical(&state, n, t));
            prop_assert!((a.position_m - b.position_m).norm() < 1e-5);
            prop_assert!((a.velocity_m_s - b.velocity_m_s).norm() < 1e-8);
            let still = driftless(&state, n);
            let short = driftless_position_m(&still, n, t);
            prop_assert!((short - closed_form(&still, n, t).position_m).norm() < 1e-8);
        }
    }
}
