//! Formations that stay together: initial conditions in the Hill frame of a chief on a near-circle.
//!
//! Source: C. Sabol, R. Burns, C. A. McLaughlin, "Satellite formation flying design and evolution", J. Spacecraft
//! and Rockets 38(2), 2001; Schwartz 2004, section 2.1.3. All satisfy (2.31): no drift to first order.

use nalgebra::Vector3;
use thiserror::Error;

use crate::elements::{Elements, OrbitError};
use crate::hill::HillState;
use crate::orbit_state::OrbitState;
use crate::{EARTH_MU_M3_S2, EARTH_RATE_RAD_S};

/// The linear equations hold for separations well below this share of the chief's radius.
const LARGEST_SHARE: f64 = 0.02;

/// Where a deputy is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Formation {
    /// Same orbit, ahead of the chief by this distance \[m\] (behind when negative).
    InPlane {
        /// Distance ahead \[m\].
        ahead_m: f64,
    },
    /// Same ground track, ahead by this distance \[m\]: its node lies where the Earth will be.
    InTrack {
        /// Distance ahead \[m\].
        ahead_m: f64,
    },
    /// At a constant distance from the chief.
    Circular {
        /// That distance \[m\].
        radius_m: f64,
        /// Where on the circle \[rad\].
        phase_rad: f64,
    },
    /// At a constant distance as seen along the radius.
    ProjectedCircular {
        /// That distance \[m\].
        radius_m: f64,
        /// Where on the circle \[rad\].
        phase_rad: f64,
    },
}

/// An invalid formation.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum FormationError {
    /// The chief's or the deputy's orbit.
    #[error("{0}")]
    Orbit(#[from] OrbitError),
    /// Too wide for the equations that keep it together.
    #[error("a separation of {separation_m:.0} m is not small against the orbit: at most {most_m:.0} m")]
    TooWide {
        /// As given \[m\].
        separation_m: f64,
        /// The most that is allowed \[m\].
        most_m: f64,
    },
}

impl Formation {
    /// Size of the formation \[m\].
    #[must_use]
    pub fn separation_m(&self) -> f64 {
        match *self {
            Self::InPlane { ahead_m } | Self::InTrack { ahead_m } => ahead_m.abs(),
            Self::Circular { radius_m, .. } | Self::ProjectedCircular { radius_m, .. } => radius_m.abs(),
        }
    }

    /// The deputy's state relative to a chief with these elements.
    ///
    /// # Errors
    /// A chief's orbit that cannot be flown, or a separation beyond the linear equations.
    pub fn deputy(&self, chief: &Elements) -> Result<HillState, FormationError> {
        chief.check()?;
        let most_m = LARGEST_SHARE * chief.semi_major_axis_m;
        let separation_m = self.separation_m();
        if separation_m.is_nan() || separation_m > most_m {
            return Err(FormationError::TooWide { separation_m, most_m });
        }
        let n = chief.mean_motion_rad_s();
        Ok(match *self {
            Self::InPlane { ahead_m } => at_rest(Vector3::new(0.0, ahead_m, 0.0)),
            Self::InTrack { ahead_m } => {
                // It passes a point of the Earth earlier, when that point had turned less: its node lies west.
                let ahead_s = ahead_m / (n * chief.semi_major_axis_m);
                let node_rad = -EARTH_RATE_RAD_S * ahead_s;
                let amplitude_m = -chief.semi_major_axis_m * node_rad * chief.inclination_rad.sin();
                let (sine, cosine) = (chief.perigee_rad + chief.true_anomaly_rad()).sin_cos();
                HillState {
                    // The shifted node moves it along its track, too.
                    position_m: Vector3::new(
                        0.0,
                        ahead_m + chief.semi_major_axis_m * node_rad * chief.inclination_rad.cos(),
                        amplitude_m * cosine,
                    ),
                    velocity_m_s: Vector3::new(0.0, 0.0, -amplitude_m * n * sine),
                }
            }
            Self::Circular { radius_m, phase_rad } => ellipse(radius_m, 0.75_f64.sqrt(), phase_rad, n),
            Self::ProjectedCircular { radius_m, phase_rad } => ellipse(radius_m, 1.0, phase_rad, n),
        })
    }
}

fn at_rest(position_m: Vector3<f64>) -> HillState {
    HillState { position_m, velocity_m_s: Vector3::zeros() }
}

/// x = r/2 sin, y = r cos, z = share r sin: the 2:1 ellipse of (2.32), (2.33), tilted.
fn ellipse(radius_m: f64, cross_track_share: f64, phase_rad: f64, n: f64) -> HillState {
    let (sine, cosine) = phase_rad.sin_cos();
    let shape = |along: f64, across: f64| Vector3::new(0.5 * along, across, cross_track_share * along);
    HillState {
        position_m: shape(sine, cosine) * radius_m,
        velocity_m_s: shape(cosine, -sine) * (radius_m * n),
    }
}

/// The deputy's inertial state with its speed changed so that its semi-major axis equals the chief's
/// exactly: (2.31) without its linearisation. What remains of a drift comes from perturbations.
#[must_use]
pub fn with_equal_energy(chief: &OrbitState, deputy: &HillState) -> OrbitState {
    let state = deputy.deputy(chief);
    let energy = 0.5 * chief.velocity_m_s.norm_squared() - EARTH_MU_M3_S2 / chief.position_m.norm();
    let speed = (2.0 * (energy + EARTH_MU_M3_S2 / state.position_m.norm())).max(0.0).sqrt();
    OrbitState { velocity_m_s: state.velocity_m_s * (speed / state.velocity_m_s.norm()), ..state }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clohessy_wiltshire::closed_form;
    use crate::propagation::Propagator;
    use crate::{EARTH_RADIUS_M, co_observation};

    fn chief() -> Elements {
        Elements {
            semi_major_axis_m: EARTH_RADIUS_M + 500e3,
            eccentricity: 0.0,
            inclination_rad: 0.9,
            node_rad: 0.4,
            perigee_rad: 0.0,
            mean_anomaly_rad: 0.7,
        }
    }

    fn over_a_revolution(formation: Formation) -> Vec<Vector3<f64>> {
        let (chief, n) = (chief(), chief().mean_motion_rad_s());
        let start = formation.deputy(&chief).unwrap();
        (0..100).map(|k| closed_form(&start, n, f64::from(k) * chief.period_s() / 100.0).position_m).collect()
    }

    #[test]
    fn each_formation_keeps_what_it_promises() {
        for p in over_a_revolution(Formation::InPlane { ahead_m: 300.0 }) {
            assert!((p - Vector3::new(0.0, 300.0, 0.0)).norm() < 1e-6);
        }
        for p in over_a_revolution(Formation::Circular { radius_m: 500.0, phase_rad: 0.6 }) {
            assert!((p.norm() - 500.0).abs() < 1e-6);
        }
        for p in over_a_revolution(Formation::ProjectedCircular { radius_m: 500.0, phase_rad: -2.0 }) {
            assert!((p.y.hypot(p.z) - 500.0).abs() < 1e-6);
        }
    }

    #[test]
    fn in_track_satellites_pass_the_same_points_of_the_earth() {
        let (chief, ahead_m) = (chief(), 20e3);
        let ahead_s = ahead_m / (chief.mean_motion_rad_s() * chief.semi_major_axis_m);
        let start = chief.state();
        let track = |formation: Formation| {
            let deputy = with_equal_energy(&start, &formation.deputy(&chief).unwrap());
            let mut worst = 0.0_f64;
            for k in 0..50 {
                let t = f64::from(k) * 100.0;
                let deputy_now = Propagator::TwoBody.after(&deputy, t).unwrap();
                let chief_then = Propagator::TwoBody.after(&start, t + ahead_s).unwrap();
                let ground =
                    |state: &OrbitState, t: f64| co_observation::ground_track_m(&state.position_m, t);
                worst = worst.max((ground(&deputy_now, t) - ground(&chief_then, t + ahead_s)).norm());
            }
            worst
        };
        let (same, plain) = (track(Formation::InTrack { ahead_m }), track(Formation::InPlane { ahead_m }));
        // The Earth turns by 1.2 km meanwhile.
        assert!(same < 100.0, "{same}");
        assert!(plain > 700.0, "{plain}");
    }

    #[test]
    fn equal_energy_stops_the_drift_that_linearisation_leaves() {
        let start = chief().state();
        let deputy =
            Formation::ProjectedCircular { radius_m: 10e3, phase_rad: 0.3 }.deputy(&chief()).unwrap();
        let drift = |deputy: OrbitState| {
            let t = 10.0 * chief().period_s();
            let after = |s: &OrbitState| Propagator::TwoBody.after(s, t).unwrap();
            (HillState::of(&after(&start), &after(&deputy)).position_m
                - HillState::of(&start, &deputy).position_m)
                .norm()
        };
        let (linear, exact) = (drift(deputy.deputy(&start)), drift(with_equal_energy(&start, &deputy)));
        assert!(exact < 1.0 && linear > 100.0, "{linear} {exact}");
    }

    #[test]
    fn formations_that_are_none_are_refused() {
        let wide = Formation::Circular { radius_m: 300e3, phase_rad: 0.0 };
        assert!(wide.deputy(&chief()).unwrap_err().to_string().contains("300000 m"));
        let low = Elements { semi_major_axis_m: 6.3e6, ..chief() };
        assert!(matches!(Formation::InPlane { ahead_m: 1.0 }.deputy(&low), Err(FormationError::Orbit(_))));
    }
}
