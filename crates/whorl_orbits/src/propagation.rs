//! Motion of one spacecraft around the Earth.

use nalgebra::{SVector, Vector3};

use crate::elements::{Elements, OrbitError};
use crate::orbit_state::OrbitState;
use crate::runge_kutta::integrate;
use crate::{EARTH_J2, EARTH_MU_M3_S2, EARTH_RADIUS_M};

/// Longest step of the numerical propagator \[s\]: millimetres over a day in a low orbit.
const STEP_S: f64 = 5.0;

/// How a spacecraft is propagated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Propagator {
    /// (2.3): two bodies, in closed form.
    TwoBody,
    /// (2.4) with the acceleration of the Earth's oblateness, numerically.
    J2,
}

impl Propagator {
    /// Energy of a unit of mass, which this motion keeps \[m^2/s^2\]. With J2:
    /// `v^2/2 - mu/r (1 - J2 (R/r)^2 (3 sin^2(latitude) - 1) / 2)`.
    #[must_use]
    pub fn energy_m2_s2(self, state: &OrbitState) -> f64 {
        let r = state.position_m.norm();
        let oblateness = match self {
            Self::TwoBody => 0.0,
            Self::J2 => {
                let sine2 = (state.position_m.z / r).powi(2);
                EARTH_J2 * (EARTH_RADIUS_M / r).powi(2) * 0.5 * (3.0 * sine2 - 1.0)
            }
        };
        0.5 * state.velocity_m_s.norm_squared() - EARTH_MU_M3_S2 / r * (1.0 - oblateness)
    }

    /// The state `dt_s` later (or earlier).
    ///
    /// # Errors
    /// A state that is not on an ellipse.
    pub fn after(self, state: &OrbitState, dt_s: f64) -> Result<OrbitState, OrbitError> {
        match self {
            Self::TwoBody => Ok(Elements::of(state)?.after(dt_s).state()),
            Self::J2 => {
                Elements::of(state)?;
                let end = integrate(state.vector(), dt_s, STEP_S, |x| {
                    let r = x.fixed_rows::<3>(0).into_owned();
                    let a = two_body_m_s2(&r) + oblateness_m_s2(&r);
                    let mut derivative = SVector::<f64, 6>::zeros();
                    derivative.fixed_rows_mut::<3>(0).copy_from(&x.fixed_rows::<3>(3));
                    derivative.fixed_rows_mut::<3>(3).copy_from(&a);
                    derivative
                });
                Ok(OrbitState::from_vector(&end))
            }
        }
    }
}

/// (2.1) \[m/s^2\].
#[must_use]
pub fn two_body_m_s2(position_m: &Vector3<f64>) -> Vector3<f64> {
    -position_m * (EARTH_MU_M3_S2 / position_m.norm().powi(3))
}

/// Acceleration of the Earth's oblateness, J2 alone \[m/s^2\] (Schaub and Junkins, equation 11.57).
#[must_use]
pub fn oblateness_m_s2(position_m: &Vector3<f64>) -> Vector3<f64> {
    let r = position_m.norm();
    let sine2 = (position_m.z / r).powi(2);
    let size = -1.5 * EARTH_J2 * EARTH_MU_M3_S2 / (r * r) * (EARTH_RADIUS_M / r).powi(2);
    let along = |factor: f64, component: f64| factor * component / r;
    Vector3::new(
        along(1.0 - 5.0 * sine2, position_m.x),
        along(1.0 - 5.0 * sine2, position_m.y),
        along(3.0 - 5.0 * sine2, position_m.z),
    ) * size
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the work of the accelerations, along an inclined ellipse.
    #[test]
    fn energy_is_kept() {
        let start = OrbitState {
            position_m: Vector3::new(7e6, 1e5, -3e5),
            velocity_m_s: Vector3::new(100.0, 5500.0, 5400.0),
        };
        for propagator in [Propagator::TwoBody, Propagator::J2] {
            let energy = propagator.energy_m2_s2(&start);
            for t in [500.0, 1500.0, 4000.0] {
                let later = propagator.energy_m2_s2(&propagator.after(&start, t).unwrap());
                assert!((later / energy - 1.0).abs() < 1e-10, "{propagator:?} {t}: {later} {energy}");
            }
        }
        // Without its own potential it is not: kilometres of the semi-major axis.
        let later = Propagator::J2.after(&start, 1500.0).unwrap();
        let [a, b] = [start, later].map(|s| Propagator::TwoBody.energy_m2_s2(&s));
        assert!((a / b - 1.0).abs() > 1e-5);
    }
}
