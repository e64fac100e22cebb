//! The relative error of a pair of platforms, gathered while a run is read.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::deg_from_rad;
use whorl_msgs::whorl::FormationState;

use crate::platform::Window;
use crate::series::{GrowingCurve, Rms};
use crate::times::{GAP_S, Recorded};

/// When pointing counts as acquired: error below this \[rad\] for this long \[s\].
const ACQUIRED: (f64, f64) = (0.1 * std::f64::consts::PI / 180.0, 1.0);

/// What is kept of a pair's relative error.
#[derive(Debug, Clone, Default)]
pub(crate) struct PairData {
    /// Angles \[deg\]: total, estimators' and controllers' part.
    pub total: GrowingCurve,
    pub estimator: GrowingCurve,
    pub control: GrowingCurve,
    /// Total error by axis \[deg\].
    pub axes: [GrowingCurve; 3],
    /// Angles in hold \[rad\]: every one, as their noise is judged.
    pub held_rad: Vec<f64>,
    pub held_estimator: Rms,
    pub held_control: Rms,
    /// Whether the error became small, and since when \[s\].
    pub acquired: Acquired,
    /// Without curves.
    pub numbers_only: bool,
}

impl PairData {
    pub fn add(&mut self, error: &RelativeError, held: bool) {
        let (t, total_rad) = (error.time_s, error.total_rad.norm());
        let estimator_rad = error.estimator_rad.map(|e| e.norm());
        let control_rad = error.control_rad.norm();
        if !self.numbers_only {
            self.total.push(t, deg_from_rad(total_rad));
            if let Some(rad) = estimator_rad {
                self.estimator.push(t, deg_from_rad(rad));
            }
            self.control.push(t, deg_from_rad(control_rad));
            for (axis, curve) in self.axes.iter_mut().enumerate() {
                curve.push(t, deg_from_rad(error.total_rad[axis]));
            }
        }
        self.acquired.add(t, total_rad);
        if held {
            self.held_rad.push(total_rad);
            estimator_rad.into_iter().for_each(|rad| self.held_estimator.add(rad));
            self.held_control.add(control_rad);
        }
    }

    /// Whether the truth of both platforms is known whenever the formation held.
    pub fn has_truth(&self) -> bool {
        !self.held_rad.is_empty() && self.held_estimator.count() == self.held_rad.len() as u64
    }
}

/// When the error became small for a second.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Acquired {
    since_s: Option<f64>,
    done: bool,
}

impl Acquired {
    pub fn add(&mut self, time_s: f64, error_rad: f64) {
        let (limit_rad, dwell_s) = ACQUIRED;
        if self.done {
        } else if error_rad >= limit_rad {
            self.since_s = None;
        } else if time_s - *self.since_s.get_or_insert(time_s) >= dwell_s {
            self.done = true;
        }
    }

    /// NaN: never.
    pub fn time_s(self) -> f64 {
        self.since_s.filter(|_| self.done).unwrap_or(f64::NAN)
    }
}

/// One instant of a follower's relative error; rotation vectors in the follower's body axes \[rad\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeError {
    /// When \[s\].
    pub time_s: f64,
    /// True relative attitude against the commanded one; from the estimates without truth.
    pub total_rad: Vector3<f64>,
    /// True against estimated relative attitude; `None` without truth.
    pub estimator_rad: Option<Vector3<f64>>,
    /// Estimated relative attitude against the commanded one.
    pub control_rad: Vector3<f64>,
}

/// The relative error of `follower` with respect to `leader` at the instants of the follower's estimates that have not
/// been evaluated yet, up to a time. The commanded relative attitude comes from the formation's states.
pub(crate) fn relative_errors<'a>(
    formation: &[Recorded<FormationState>],
    [follower, leader]: [&str; 2],
    [of_follower, of_leader]: [&'a Window; 2],
    until_s: f64,
) -> impl Iterator<Item = RelativeError> + use<'a> {
    let commanded = commanded_relative_attitude(formation, follower, leader);
    let mut next = 0;
    of_follower.estimate.between(of_follower.estimates_to_s, until_s).filter_map(
        move |(time_s, follower_estimate)| {
            while commanded.get(next + 1).is_some_and(|(t, _)| *t <= time_s) {
                next += 1;
            }
            let (since, command) = commanded.get(next).filter(|(t, _)| *t <= time_s)?;
            // An older formation state does not tell the current command.
            if time_s - since > 1.0 {
                return None;
            }
            let leader_estimate = of_leader.estimate.at(time_s, GAP_S)?;
            let estimated = leader_estimate.inverse() * follower_estimate;
            let control_rad = whorl_math::attitude_error(command, &estimated);
            let truth = of_follower.truth.at(time_s, GAP_S).zip(of_leader.truth.at(time_s, GAP_S));
            let actual = truth.map(|(f, l)| l.inverse() * f);
            Some(RelativeError {
                time_s,
                total_rad: actual.map_or(control_rad, |a| whorl_math::attitude_error(command, &a)),
                estimator_rad: actual.map(|a| whorl_math::attitude_error(&estimated, &a)),
                control_rad,
            })
        },
    )
}

fn commanded_relative_attitude(
    formation: &[Recorded<FormationState>],
    follower: &str,
    leader: &str,
) -> Vec<(f64, UnitQuaternion<f64>)> {
    let commands = formation.iter().filter_map(|state| {
        let m = &state.message;
        let f = m.platforms.iter().position(|p| p == follower)?;
        let l = usize::try_from(*m.leader.get(f)?).ok()?;
        (m.platforms.get(l)? == leader).then_some(())?;
        Some((state.stamp_s, m.q_leader_platform.get(f)?.to_unit()?))
    });
    commands.collect()
}

/// Follower and leader of every pair.
pub(crate) fn pairs_of(state: &FormationState) -> impl Iterator<Item = (String, String)> + '_ {
    state.platforms.iter().zip(&state.leader).filter_map(|(follower, leader)| {
        let leader = state.platforms.get(usize::try_from(*leader).ok()?)?;
        Some((follower.clone(), leader.clone()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pointing_is_acquired_where_the_error_begins_to_stay_small() {
        let acquired_s = |degs: &[f64]| {
            let mut acquired = Acquired::default();
            for (i, deg) in degs.iter().enumerate() {
                acquired.add(0.25 * i as f64, deg.to_radians());
            }
            acquired.time_s()
        };
        // Small for a moment, then for good.
        assert_eq!(acquired_s(&[1.0, 0.05, 0.3, 0.09, 0.05, 0.02, 0.02, 0.02, 0.5]), 0.75);
        assert!(acquired_s(&[1.0, 0.05, 0.05, 0.05]).is_nan(), "not for a second");
        assert!(acquired_s(&[]).is_nan());
    }
}
