//! A pass over the target: where every spacecraft is and how it must point, over time.

use nalgebra::Vector3;
use thiserror::Error;

use crate::co_observation::{Mounting, Pointing, Target, TargetError, elevation_rad, pointing};
use crate::elements::{Elements, OrbitError};
use crate::formation::{Formation, FormationError, with_equal_energy};
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

/// The velocity change that a spacecraft wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WantedDeltaV {
    /// None.
    None,
    /// This one, in its chief's Hill frame \[m/s\].
    Hill(Vector3<f64>),
    /// What takes the drift out of its relative motion: `-(y' + 2 n x)` along the track (2.31).
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
    /// Every spacecraft at a time after the epoch \[s\].
    ///
    /// # Errors
    /// Why a pass is invalid.
    pub fn at(&self, time_s: f64) -> Result<Vec<Sight>, PassError> {
        self.chief.check()?;
        if self.model == RelativeModel::ClohessyWiltshire && self.chief.eccentricity > CIRCLE {
            return Err(PassError::NotCircular { eccentricity: self.chief.eccentricity });
        }
        let propagator = if self.model == RelativeModel::J2 { Propagator::J2 } else { Propagator::TwoBody };
        let epoch = self.chief.state();
        let chief = propagator.after(&epoch, time_s)?;
        let n = self.chief.mean_motion_rad_s();
        let mut states = Vec::with_capacity(self.spacecraft.len());
        for spacecraft in &self.spacecraft {
            states.push(match &spacecraft.formation {
                None => chief,
                Some(formation) => {
                    let start = formation.deputy(&self.chief)?;
                    match self.model {
                        RelativeModel::TwoBody | RelativeModel::J2 => {
                            propagator.after(&with_equal_energy(&epoch, &start), time_s)?
                        }
                        RelativeModel::Nonlinear => {
                            let start = HillState::of(&epoch, &with_equal_energy(&epoch, &start));
                            relative_motion::after(&epoch, &start, time_s).deputy(&chief)
                        }
                        RelativeModel::ClohessyWiltshire => {
                            clohessy_wiltshire::closed_form(&start, n, time_s).deputy(&chief)
                        }
                        RelativeModel::YamanakaAnkersen => {
                            yamanaka_ankersen::after(&self.chief, &start, time_s).deputy(&chief)
                        }
                    }
                }
            });
        }
        let positions: Vec<_> = states.iter().map(|s| s.position_m).collect();
        let target = self.target.position_m(&positions, time_s)?;
        let to_eci = eci_from_hill(&chief);
        let mut sights = Vec::with_capacity(states.len());
        for (index, (spacecraft, state)) in self.spacecraft.iter().zip(&states).enumerate() {
            let relative = HillState::of(&chief, state);
            let elevation = elevation_rad(&target, &state.position_m);
            if elevation < 0.0 {
                let below_deg = -elevation.to_degrees();
                return Err(TargetError::BelowHorizon { spacecraft: index, below_deg }.into());
            }
            let wanted_hill = match spacecraft.wanted {
                WantedDeltaV::None => Vector3::zeros(),
                WantedDeltaV::Hill(delta_v) => delta_v,
                WantedDeltaV::RemoveDrift => {
                    let drift = relative.velocity_m_s.y + 2.0 * n * relative.position_m.x;
                    Vector3::new(0.0, -drift, 0.0)
                }
            };
            let line_of_sight = target - state.position_m;
            let pointing = pointing(
                &spacecraft.mounting,
                &line_of_sight,
                &(to_eci * wanted_hill),
                &state.velocity_m_s,
                self.thrust_weight,
            );
            sights.push(Sight { state: *state, relative, pointing, elevation_rad: elevation });
        }
        Ok(sights)
    }
}
