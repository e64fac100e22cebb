//! Formations that stay together: initial conditions in the Hill frame of a chief on a near-circle.
//!
//! On an ellipse a formation started so and brought to the chief's energy stays together, but its shape breathes: the
//! distance that is promised varies by about `4 e` of itself on the circular formations and by `2 e` on the other two
//! (two-body motion, the worst over phase and anomaly; a test measures it). More than a fifth is refused.
//!
//! Source: C. Sabol, R. Burns, C. A. McLaughlin, "Satellite formation flying design and evolution", J. Spacecraft
//! and Rockets 38(2), 2001; Schwartz 2004, section 2.1.3. All satisfy (2.31): no drift to first order.

use nalgebra::Vector3;
use thiserror::Error;

use crate::EARTH_RATE_RAD_S;
use crate::drift::delta_v_eci_m_s;
use crate::elements::{Elements, OrbitError};
use crate::hill::HillState;
use crate::orbit_state::OrbitState;
use crate::propagation::Propagator;

/// The linear equations hold for separations well below this share of the chief's radius.
const LARGEST_SHARE: f64 = 0.02;

/// Share of the promised distance by which an eccentric chief may spoil it.
const LARGEST_SPOILING: f64 = 0.2;

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
    /// The chief's orbit is too far from a circle.
    #[error(
        "a chief with eccentricity {eccentricity} cannot keep this formation: its distance would vary by {:.0} %; eccentricities up to {most} can",
        100.0 * .spoiling
    )]
    TooEccentric {
        /// As given.
        eccentricity: f64,
        /// Share of the promised distance by which it would vary.
        spoiling: f64,
        /// The most that is allowed.
        most: f64,
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

    /// Share of the promised distance by which it varies on an ellipse, for each unit of eccentricity.
    fn spoiling(&self) -> f64 {
        match self {
            Self::InPlane { .. } | Self::InTrack { .. } => 2.0,
            Self::Circular { .. } | Self::ProjectedCircular { .. } => 4.0,
        }
    }

    /// The largest eccentricity of a chief that can keep this formation.
    #[must_use]
    pub fn largest_eccentricity(&self) -> f64 {
        LARGEST_SPOILING / self.spoiling()
    }

    /// The deputy's state relative to a chief with these elements.
    ///
    /// # Errors
    /// A chief's orbit that cannot be flown, a separation beyond the linear equations, or an ellipse that would not keep
    /// the formation's shape.
    pub fn deputy(&self, chief: &Elements) -> Result<HillState, FormationError> {
        chief.check()?;
        let most_m = LARGEST_SHARE * chief.semi_major_axis_m;
        let separation_m = self.separation_m();
        if separation_m.is_nan() || separation_m > most_m {
            return Err(FormationError::TooWide { separation_m, most_m });
        }
        let (eccentricity, most) = (chief.eccentricity, self.largest_eccentricity());
        if eccentricity > most {
            let spoiling = self.spoiling() * eccentricity;
            return Err(FormationError::TooEccentric { eccentricity, spoiling, most });
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

/// The deputy's inertial state with its speed changed so that it does not drift along the chief's track: (2.31) without its
/// linearisation, on any orbit, the oblateness included where the propagator has it ([`crate::drift`]).
#[must_use]
pub fn without_drift(propagator: Propagator, chief: &OrbitState, deputy: &HillState) -> OrbitState {
    let state = deputy.deputy(chief);
    let wanted_m_s = delta_v_eci_m_s(propagator, chief, &state);
    OrbitState { velocity_m_s: state.velocity_m_s + wanted_m_s, ..state }
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
            let deputy = without_drift(Propagator::TwoBody, &start, &formation.deputy(&chief).unwrap());
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
        let (linear, exact) =
            (drift(deputy.deputy(&start)), drift(without_drift(Propagator::TwoBody, &start, &deputy)));
        assert!(exact < 1.0 && linear > 100.0, "{linear} {exact}");
    }

    /// By two-body motion over a revolution, from eight anomalies and phases: what the bound on the eccentricity says.
    #[test]
    fn an_ellipse_spoils_the_shape_as_stated_and_no_more() {
        let eccentricity = 0.05;
        let worst = |distance: &dyn Fn(&Vector3<f64>) -> f64, formation: &dyn Fn(f64) -> Formation| {
            let mut worst = 0.0_f64;
            for k in 0..64 {
                let [anomaly, phase] = [k % 8, k / 8].map(|n| f64::from(n) * std::f64::consts::FRAC_PI_4);
                let ellipse = Elements {
                    semi_major_axis_m: (EARTH_RADIUS_M + 500e3) / (1.0 - eccentricity),
                    eccentricity,
                    mean_anomaly_rad: anomaly,
                    ..chief()
                };
                let start = ellipse.state();
                let relative = formation(phase).deputy(&ellipse).unwrap();
                let deputy = without_drift(Propagator::TwoBody, &start, &relative);
                for step in 0..40 {
                    let t = f64::from(step) / 40.0 * ellipse.period_s();
                    let [c, d] = [&start, &deputy].map(|s| Propagator::TwoBody.after(s, t).unwrap());
                    worst = worst.max((distance(&HillState::of(&c, &d).position_m) / 1000.0 - 1.0).abs());
                }
            }
            worst
        };
        let in_plane = worst(&|p| p.norm(), &|_| Formation::InPlane { ahead_m: 1000.0 });
        let circular = worst(&|p| p.norm(), &|phase_rad| Formation::Circular { radius_m: 1000.0, phase_rad });
        let projected = worst(&|p| p.y.hypot(p.z), &|phase_rad| Formation::ProjectedCircular {
            radius_m: 1000.0,
            phase_rad,
        });
        assert!((in_plane / eccentricity - 2.0).abs() < 0.2, "{in_plane}");
        assert!((circular / eccentricity - 4.0).abs() < 0.3, "{circular}");
        assert!((projected / eccentricity - 4.0).abs() < 0.3, "{projected}");
        let beyond = Elements { eccentricity: 0.06, semi_major_axis_m: 8e6, ..chief() };
        let refused = Formation::Circular { radius_m: 1e3, phase_rad: 0.0 }.deputy(&beyond).unwrap_err();
        assert!(refused.to_string().contains("eccentricity 0.06"), "{refused}");
        assert!(refused.to_string().contains("up to 0.05"), "{refused}");
    }

    #[test]
    fn formations_that_are_none_are_refused() {
        let wide = Formation::Circular { radius_m: 300e3, phase_rad: 0.0 };
        assert!(wide.deputy(&chief()).unwrap_err().to_string().contains("300000 m"));
        let low = Elements { semi_major_axis_m: 6.3e6, ..chief() };
        assert!(matches!(Formation::InPlane { ahead_m: 1.0 }.deputy(&low), Err(FormationError::Orbit(_))));
    }
}
