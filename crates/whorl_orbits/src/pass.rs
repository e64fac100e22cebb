//! A pass over the target: where every spacecraft is and how it must point, over time.

use nalgebra::Vector3;
use thiserror::Error;

use crate::burn::Burn;
use crate::co_observation::{Mounting, Pointing, Target, TargetError, elevation_rad, pointing};
use crate::drift::{delta_v_eci_m_s, linear_delta_v_hill_m_s};
use crate::elements::{Elements, OrbitError};
use crate::formation::{Formation, FormationError, without_drift};
use crate::hill::{HillState, eci_from_hill};
use crate::orbit_state::OrbitState;
use crate::propagation::Propagator;
use crate::{clohessy_wiltshire, relative_motion, yamanaka_ankersen};

/// Eccentricities above this are no circle for the equations that need one.
const CIRCLE: f64 = 1e-3;

/// How deputies move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RelativeModel {
    /// Each spacecraft by two-body motion.
    TwoBody,
    /// Each spacecraft by two-body motion with J2.
    J2,
    /// (2.18)-(2.20).
    Nonlinear,
    /// (2.28)-(2.30); for a chief on a circle.
    ClohessyWiltshire,
    /// Yamanaka and Ankersen's state-transition matrix.
    YamanakaAnkersen,
}

impl RelativeModel {
    /// Whether it is linear in the separation.
    #[must_use]
    pub fn is_linear(self) -> bool {
        matches!(self, Self::ClohessyWiltshire | Self::YamanakaAnkersen)
    }
}

/// The velocity change that a spacecraft wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WantedDeltaV {
    /// None.
    None,
    /// This one, in its chief's Hill frame \[m/s\].
    Hill(Vector3<f64>),
    /// The smallest that takes the drift along the track out of its relative motion ([`crate::drift`]): by the energies, with
    /// J2 by the secular rates. None where nothing drifts, as in every formation that was started by [`Formation`].
    RemoveDrift,
}

/// One spacecraft of the pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spacecraft {
    /// Its place relative to the chief's orbit; `None`: on it.
    pub formation: Option<Formation>,
    /// Its instruments.
    pub mounting: Mounting,
    /// Its wanted velocity change.
    pub wanted: WantedDeltaV,
    /// How it carries that out; `None`: it only turns its thruster there.
    pub burn: Option<Burn>,
    /// By how much its velocity is off at the epoch, Hill axes \[m/s\].
    pub velocity_error_hill_m_s: Vector3<f64>,
}

/// The whole pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// The chief's orbit at time 0. No spacecraft need be there.
    pub chief: Elements,
    /// How deputies move.
    pub model: RelativeModel,
    /// The spacecraft, in the order of platforms.
    pub spacecraft: Vec<Spacecraft>,
    /// What they observe.
    pub target: Target,
    /// Share of the mismatch that the boresight takes: 0 to 1.
    pub thrust_weight: f64,
}

/// An invalid pass.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PassError {
    /// An orbit.
    #[error("{0}")]
    Orbit(#[from] OrbitError),
    /// A formation.
    #[error("{0}")]
    Formation(#[from] FormationError),
    /// The target.
    #[error("{0}")]
    Target(#[from] TargetError),
    /// The model does not hold for this chief.
    #[error(
        "the Clohessy-Wiltshire equations hold for circular chiefs: eccentricity {eccentricity} is above {CIRCLE}; use yamanaka_ankersen or nonlinear"
    )]
    NotCircular {
        /// As given.
        eccentricity: f64,
    },
    /// A number of a burn.
    #[error("{name} = {value} of a burn must be {}", if *.name == "start_s" { "0 or more" } else { "positive" })]
    Burn {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
    },
    /// Thrust in a model of relative motion alone.
    #[error("a burn changes the orbit of one spacecraft: the model must be two_body or j2")]
    ThrustWithoutOrbits,
}

/// One spacecraft at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Its state, inertial axes.
    pub state: OrbitState,
    /// Relative to the chief.
    pub relative: HillState,
    /// Where it points.
    pub pointing: Pointing,
    /// Its elevation above the target's horizon \[rad\].
    pub elevation_rad: f64,
}

impl Pass {
    /// How each spacecraft moves by itself.
    #[must_use]
    pub fn propagator(&self) -> Propagator {
        if self.model == RelativeModel::J2 { Propagator::J2 } else { Propagator::TwoBody }
    }

    /// The chief's orbit and every spacecraft at a time, without thrust.
    pub(crate) fn unperturbed(&self, time_s: f64) -> Result<(OrbitState, Vec<OrbitState>), PassError> {
        self.chief.check()?;
        if self.model == RelativeModel::ClohessyWiltshire && self.chief.eccentricity > CIRCLE {
            return Err(PassError::NotCircular { eccentricity: self.chief.eccentricity });
        }
        let propagator = self.propagator();
        let epoch = self.chief.state();
        let chief = propagator.after(&epoch, time_s)?;
        let n = self.chief.mean_motion_rad_s();
        let mut states = Vec::with_capacity(self.spacecraft.len());
        for spacecraft in &self.spacecraft {
            let error = spacecraft.velocity_error_hill_m_s;
            let exact = |start: &HillState| {
                with_velocity_error(&epoch, &without_drift(propagator, &epoch, start), &error)
            };
            states.push(match &spacecraft.formation {
                None if error == Vector3::zeros() => chief,
                None => propagator.after(&with_velocity_error(&epoch, &epoch, &error), time_s)?,
                Some(formation) => {
                    let start = formation.deputy(&self.chief)?;
                    match self.model {
                        RelativeModel::TwoBody | RelativeModel::J2 => {
                            propagator.after(&exact(&start), time_s)?
                        }
                        RelativeModel::Nonlinear => {
                            let start = HillState::of(&epoch, &exact(&start));
                            relative_motion::after(&epoch, &start, time_s).deputy(&chief)
                        }
                        RelativeModel::ClohessyWiltshire => {
                            let mut start = start;
                            start.velocity_m_s += error;
                            clohessy_wiltshire::closed_form(&start, n, time_s).deputy(&chief)
                        }
                        RelativeModel::YamanakaAnkersen => {
                            let mut start = start;
                            start.velocity_m_s += linear_delta_v_hill_m_s(&epoch, &start) + error;
                            yamanaka_ankersen::after(&self.chief, &start, time_s).deputy(&chief)
                        }
                    }
                }
            });
        }
        Ok((chief, states))
    }

    /// What a spacecraft in this state wants, inertial axes \[m/s\].
    pub(crate) fn wanted_eci_m_s(
        &self,
        wanted: WantedDeltaV,
        chief: &OrbitState,
        state: &OrbitState,
    ) -> Vector3<f64> {
        match wanted {
            WantedDeltaV::None => Vector3::zeros(),
            WantedDeltaV::Hill(delta_v) => eci_from_hill(chief) * delta_v,
            // In a linearised model's own terms: exact energies differ there by what it neglects.
            WantedDeltaV::RemoveDrift if self.model.is_linear() => {
                eci_from_hill(chief) * linear_delta_v_hill_m_s(chief, &HillState::of(chief, state))
            }
            WantedDeltaV::RemoveDrift => delta_v_eci_m_s(self.propagator(), chief, state),
        }
    }

    /// Where every spacecraft points that is in these states; `wanted` gives each one's wanted velocity change, inertial
    /// axes \[m/s\].
    pub(crate) fn sights(
        &self,
        time_s: f64,
        chief: &OrbitState,
        states: &[OrbitState],
        wanted: impl Fn(usize, &OrbitState) -> Vector3<f64>,
    ) -> Result<Vec<Sight>, PassError> {
        let positions: Vec<_> = states.iter().map(|s| s.position_m).collect();
        let target = self.target.position_m(&positions, time_s)?;
        let mut sights = Vec::with_capacity(states.len());
        for (index, (spacecraft, state)) in self.spacecraft.iter().zip(states).enumerate() {
            let relative = HillState::of(chief, state);
            let elevation = elevation_rad(&target, &state.position_m);
            if elevation < 0.0 {
                let below_deg = -elevation.to_degrees();
                return Err(TargetError::BelowHorizon { spacecraft: index, below_deg }.into());
            }
            let line_of_sight = target - state.position_m;
            let pointing = pointing(
                &spacecraft.mounting,
                &line_of_sight,
                &wanted(index, state),
                &state.velocity_m_s,
                self.thrust_weight,
            );
            sights.push(Sight { state: *state, relative, pointing, elevation_rad: elevation });
        }
        Ok(sights)
    }
}

/// A deputy's place relative to the chief's orbit, with an error of its velocity that a burn may take out.
#[must_use]
fn with_velocity_error(chief: &OrbitState, deputy: &OrbitState, error_hill_m_s: &Vector3<f64>) -> OrbitState {
    let mut relative = HillState::of(chief, deputy);
    relative.velocity_m_s += error_hill_m_s;
    relative.deputy(chief)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::pass;

    const MODELS: [RelativeModel; 5] = [
        RelativeModel::TwoBody,
        RelativeModel::J2,
        RelativeModel::Nonlinear,
        RelativeModel::ClohessyWiltshire,
        RelativeModel::YamanakaAnkersen,
    ];

    /// A formation of the shipped experiment's size does not drift, so no model asks for a velocity change; (2.31) asked for
    /// up to 0.16 m/s of it.
    #[test]
    fn where_nothing_drifts_nothing_is_wanted() {
        let formation = Formation::ProjectedCircular { radius_m: 30e3, phase_rad: 1.0 };
        for model in MODELS {
            let pass = pass(model, 0.0, formation, WantedDeltaV::RemoveDrift);
            for time_s in [0.0, 100.0, 320.0] {
                let sights = pass.at(time_s).unwrap();
                assert!(sights[1].pointing.mission_angle_rad.is_nan(), "{model:?} {time_s}");
            }
        }
    }

    /// In-track position after ten revolutions less that after nine \[m\].
    fn drift_m(pass: &Pass) -> f64 {
        let along = |k: f64| pass.at(k * pass.chief.period_s()).unwrap()[1].relative.position_m.y;
        along(10.0) - along(9.0)
    }

    /// 20 km in track at e = 0.1 drifted by 33 km a revolution with Yamanaka and Ankersen's equations.
    #[test]
    fn eccentric_chiefs_keep_their_deputies() {
        for model in MODELS.into_iter().filter(|m| !matches!(m, RelativeModel::ClohessyWiltshire)) {
            // The oblateness turns both perigees alike; what is left of it is of second order.
            let allowed_m = if model == RelativeModel::J2 { 20.0 } else { 1.0 };
            for eccentricity in [0.0, 0.02, 0.05, 0.1] {
                let formation = Formation::InTrack { ahead_m: 20e3 };
                let drift = drift_m(&pass(model, eccentricity, formation, WantedDeltaV::None));
                assert!(drift.abs() < allowed_m, "{model:?}, e {eccentricity}: {drift} m a revolution");
            }
        }
    }

    #[test]
    fn a_chief_that_cannot_keep_the_formation_is_named() {
        let formation = Formation::ProjectedCircular { radius_m: 20e3, phase_rad: 1.0 };
        for model in [RelativeModel::YamanakaAnkersen, RelativeModel::TwoBody] {
            let error = pass(model, 0.07, formation, WantedDeltaV::None).at(0.0).unwrap_err().to_string();
            assert!(error.contains("eccentricity 0.07") && error.contains("up to 0.05"), "{error}");
        }
    }
}
