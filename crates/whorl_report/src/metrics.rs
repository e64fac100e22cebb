//! The numbers of a run.

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;
use whorl_math::statistics::quantile;
use whorl_msgs::whorl::{ClockRequest, ControlStatus, FormationState};

use crate::data::{PlatformData, RunData};
use crate::series::{AttitudeSeries, maximum, rms};

/// Longest gap over which attitudes are interpolated \[s\].
const GAP_S: f64 = 0.2;

/// The numbers of a run. NaN (null in JSON): cannot be computed from this run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Version of this structure.
    pub schema: u32,
    /// Name of the experiment.
    pub experiment: String,
    /// Relative-attitude law.
    pub law: String,
    /// How the run ended: finished, aborted, or the last phase.
    pub outcome: String,
    /// Time between the first and the last message \[s\].
    pub duration_s: f64,
    /// One entry per following platform.
    pub pairs: Vec<PairSummary>,
    /// Per platform.
    pub platforms: Vec<PlatformSummary>,
}

/// Relative pointing of one platform with respect to its leader, while the formation holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairSummary {
    /// The platform.
    pub follower: String,
    /// The one it follows.
    pub leader: String,
    /// When pointing was acquired: from the first message to where the relative error stays below 0.1 deg
    /// for a second \[s\].
    pub acquired_s: f64,
    /// Length of the hold phases \[s\].
    pub hold_s: f64,
    /// RMS angle between the true relative attitude and the commanded one \[rad\].
    pub relative_error_rms_rad: f64,
    /// Largest angle between the true relative attitude and the commanded one \[rad\].
    pub relative_error_max_rad: f64,
    /// RMS angle between the true and the estimated relative attitude \[rad\].
    pub estimator_error_rms_rad: f64,
    /// RMS angle between the estimated relative attitude and the commanded one \[rad\].
    pub control_error_rms_rad: f64,
    /// Whether the true attitude was recorded; if not, the relative error is computed from the estimates.
    pub from_truth: bool,
}

/// One platform.
#[derive(Debug, Default, Clone, PartialEq, Serialize)]
pub struct PlatformSummary {
    /// Its name.
    pub name: String,
    /// RMS angle between the true attitude and the reference, in hold \[rad\].
    pub pointing_error_rms_rad: f64,
    /// RMS angle between the true attitude and the estimate, whole run \[rad\].
    pub estimator_error_rms_rad: f64,
    /// Part of the estimator error about the vertical \[rad\].
    pub estimator_heading_error_rms_rad: f64,
    /// Part of the estimator error across the vertical \[rad\].
    pub estimator_inclination_error_rms_rad: f64,
    /// Gas used, by the controller's model \[kg\].
    pub gas_used_kg: f64,
    /// Total commanded-open time of all jets \[s\].
    pub jet_on_time_s: f64,
    /// Largest wheel speed [rad/s].
    pub wheel_speed_max_rad_s: f64,
    /// Smallest attainable share of the requested torque.
    pub alpha_min: f64,
    /// Allocation problems that were not solved.
    pub allocation_fallbacks: u64,
    /// Age of the estimate when the controller acted on it, median \[s\].
    pub sensor_to_command_p50_s: f64,
    /// The same, 99th percentile \[s\].
    pub sensor_to_command_p99_s: f64,
    /// Largest age of the platform's estimate at the coordinator, after start \[s\].
    pub link_age_max_s: f64,
    /// Clock of its computer less the coordinator's, as measured last \[s\].
    pub clock_offset_s: f64,
    /// Bound on the error of the clock offset \[s\].
    pub clock_uncertainty_s: f64,
    /// Sensor samples that the estimator rejected.
    pub rejected_samples: u32,
    /// Time in a mode other than tracking, after start \[s\].
    pub not_tracking_s: f64,
}

/// A stretch of time \[s\].
pub type Interval = (f64, f64);

/// Time spans of the hold phases.
#[must_use]
pub fn hold_intervals(run: &RunData) -> Vec<Interval> {
    let mut intervals: Vec<Interval> = Vec::new();
    let mut open: Option<f64> = None;
    for state in &run.formation {
        match (open, state.message.phase == FormationState::PHASE_HOLD) {
            (None, true) => open = Some(state.stamp_s),
            (Some(start), false) => {
                intervals.push((start, state.stamp_s));
                open = None;
            }
            _ => {}
        }
    }
    if let (Some(start), Some(last)) = (open, run.formation.last()) {
        intervals.push((start, last.stamp_s));
    }
    intervals
}

fn within(intervals: &[Interval], time_s: f64) -> bool {
    intervals.iter().any(|(start, end)| (*start..=*end).contains(&time_s))
}

/// True and estimated attitudes and the reference of one platform.
#[derive(Debug, Clone, Default)]
pub struct Attitudes {
    /// Truth; empty when there is none.
    pub truth: AttitudeSeries,
    /// Usable estimates.
    pub estimate: AttitudeSeries,
    /// References.
    pub reference: AttitudeSeries,
}

impl Attitudes {
    /// Of one platform.
    #[must_use]
    pub fn new(data: &PlatformData) -> Self {
        let usable = data.estimate.iter().filter(|e| e.message.usable());
        Self {
            truth: AttitudeSeries::new(data.truth.iter().map(|m| (m.stamp_s, m.message.q_world_body))),
            estimate: AttitudeSeries::new(usable.map(|m| (m.stamp_s, m.message.q_world_body))),
            reference: AttitudeSeries::new(
                data.reference.iter().map(|m| (m.stamp_s, m.message.q_world_reference)),
            ),
        }
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

/// The relative error of `follower` with respect to `leader` over the run, at the instants of the
/// follower's estimates. The commanded relative attitude comes from the formation's state.
#[must_use]
pub fn relative_errors(
    run: &RunData,
    follower: &str,
    leader: &str,
    attitudes: [&Attitudes; 2],
) -> Vec<RelativeError> {
    let commanded = commanded_relative_attitude(run, follower, leader);
    let [of_follower, of_leader] = attitudes;
    let mut next = 0;
    let mut errors = Vec::new();
    for (time_s, follower_estimate) in of_follower.estimate.iter() {
        while commanded.get(next + 1).is_some_and(|(t, _)| *t <= time_s) {
            next += 1;
        }
        let Some((since, command)) = commanded.get(next).filter(|(t, _)| *t <= time_s) else { continue };
        // An older formation state does not tell the current command.
        if time_s - since > 1.0 {
            continue;
        }
        let Some(leader_estimate) = of_leader.estimate.at(time_s, GAP_S) else { continue };
        let estimated = leader_estimate.inverse() * follower_estimate;
        let control_rad = whorl_math::attitude_error(command, &estimated);
        let truth = of_follower.truth.at(time_s, GAP_S).zip(of_leader.truth.at(time_s, GAP_S));
        let actual = truth.map(|(f, l)| l.inverse() * f);
        errors.push(RelativeError {
            time_s,
            total_rad: actual.map_or(control_rad, |a| whorl_math::attitude_error(command, &a)),
            estimator_rad: actual.map(|a| whorl_math::attitude_error(&estimated, &a)),
            control_rad,
        });
    }
    errors
}

fn commanded_relative_attitude(
    run: &RunData,
    follower: &str,
    leader: &str,
) -> Vec<(f64, UnitQuaternion<f64>)> {
    let commands = run.formation.iter().filter_map(|state| {
        let m = &state.message;
        let f = m.platforms.iter().position(|p| p == follower)?;
        let l = usize::try_from(*m.leader.get(f)?).ok()?;
        (m.platforms.get(l)? == leader).then_some(())?;
        Some((state.stamp_s, m.q_leader_platform.get(f)?.to_unit()?))
    });
    commands.collect()
}

/// Follower and leader of every pair that the formation state names.
#[must_use]
pub fn pairs(run: &RunData) -> Vec<(String, String)> {
    let Some(last) = run.formation.last() else { return Vec::new() };
    let m = &last.message;
    m.platforms
        .iter()
        .zip(&m.leader)
        .filter_map(|(follower, leader)| {
            let leader = m.platforms.get(usize::try_from(*leader).ok()?)?;
            Some((follower.clone(), leader.clone()))
        })
        .collect()
}

/// Computes the numbers of a run.
#[must_use]
pub fn summarise(run: &RunData) -> Summary {
    let hold = hold_intervals(run);
    let attitudes: std::collections::BTreeMap<&String, Attitudes> =
        run.platforms.iter().map(|(name, data)| (name, Attitudes::new(data))).collect();
    let pair_summaries = pairs(run)
        .into_iter()
        .filter_map(|(follower, leader)| {
            let errors = relative_errors(
                run,
                &follower,
                &leader,
                [attitudes.get(&follower)?, attitudes.get(&leader)?],
            );
            Some(summarise_pair(follower, leader, &hold, &errors))
        })
        .collect();
    let last = run.formation.last().map(|s| &s.message);
    Summary {
        schema: 1,
        experiment: last.map_or_else(String::new, |m| m.experiment.clone()),
        law: last.map_or_else(String::new, |m| m.law.clone()),
        outcome: last.map_or("no formation state", |m| phase_name(m.phase)).to_owned(),
        duration_s: run.duration_s,
        pairs: pair_summaries,
        platforms: run
            .platforms
            .iter()
            .filter_map(|(name, data)| Some(summarise_platform(run, name, data, attitudes.get(name)?, &hold)))
            .collect(),
    }
}

/// The phase in words.
#[must_use]
pub fn phase_name(phase: u8) -> &'static str {
    match phase {
        FormationState::PHASE_WAITING => "waiting",
        FormationState::PHASE_READY => "ready",
        FormationState::PHASE_SETTLE => "settle",
        FormationState::PHASE_MANOEUVRE => "manoeuvre",
        FormationState::PHASE_HOLD => "hold",
        FormationState::PHASE_FINISHED => "finished",
        FormationState::PHASE_ABORTED => "aborted",
        _ => "unknown",
    }
}

/// Relative error below which pointing counts as acquired, and for how long it must stay there.
const ACQUIRED: (f64, f64) = (0.1 * std::f64::consts::PI / 180.0, 1.0);

/// NaN: never.
fn acquired_s(errors: &[RelativeError]) -> f64 {
    let (limit_rad, dwell_s) = ACQUIRED;
    let mut since = None;
    for error in errors {
        if error.total_rad.norm() >= limit_rad {
            since = None;
        } else if error.time_s - *since.get_or_insert(error.time_s) >= dwell_s {
            break;
        }
    }
    since.filter(|t| errors.last().is_some_and(|last| last.time_s - t >= dwell_s)).unwrap_or(f64::NAN)
}

fn summarise_pair(
    follower: String,
    leader: String,
    hold: &[Interval],
    errors: &[RelativeError],
) -> PairSummary {
    let held: Vec<_> = errors.iter().filter(|e| within(hold, e.time_s)).collect();
    PairSummary {
        follower,
        leader,
        acquired_s: acquired_s(errors),
        hold_s: hold.iter().map(|(start, end)| end - start).sum(),
        relative_error_rms_rad: rms(held.iter().map(|e| e.total_rad.norm())),
        relative_error_max_rad: maximum(held.iter().map(|e| e.total_rad.norm())),
        estimator_error_rms_rad: rms(held.iter().filter_map(|e| e.estimator_rad).map(|e| e.norm())),
        control_error_rms_rad: rms(held.iter().map(|e| e.control_rad.norm())),
        from_truth: !held.is_empty() && held.iter().all(|e| e.estimator_rad.is_some()),
    }
}

/// Error of the estimate: rotation from the estimated to the true attitude, in world axes \[rad\].
pub(crate) fn estimator_errors(attitudes: &Attitudes) -> Vec<(f64, Vector3<f64>)> {
    attitudes
        .estimate
        .iter()
        .filter_map(|(t, q)| {
            Some((t, whorl_math::rotation_vector(&(attitudes.truth.at(t, GAP_S)? * q.inverse()))))
        })
        .collect()
}

/// Latest known offset of a platform's clock; NaN if it was not measured.
fn last_clock(run: &RunData, name: &str, values: fn(&ClockRequest) -> &Vec<f64>) -> f64 {
    let of_platform = |clocks: &ClockRequest| {
        let index = clocks.platforms.iter().position(|p| p == name)?;
        values(clocks).get(index).copied().filter(|value| value.is_finite())
    };
    run.clocks.iter().rev().find_map(|c| of_platform(&c.message)).unwrap_or(f64::NAN)
}

fn summarise_platform(
    run: &RunData,
    name: &str,
    data: &PlatformData,
    attitudes: &Attitudes,
    hold: &[Interval],
) -> PlatformSummary {
    let estimator = estimator_errors(attitudes);
    let pointing = attitudes
        .reference
        .iter()
        .filter(|(t, _)| within(hold, *t))
        .filter_map(|(t, reference)| Some(attitudes.truth.at(t, GAP_S)?.angle_to(&reference)));
    // Before the start the controller idles; its numbers are not part of the run's.
    let started =
        run.formation.iter().find(|s| s.message.run_elapsed_s > 0.0).map_or(f64::INFINITY, |s| s.stamp_s);
    let ended = run.formation.iter().find(|s| s.message.phase >= FormationState::PHASE_FINISHED);
    let ended = ended.map_or(f64::INFINITY, |s| s.stamp_s);
    let running = || data.control.iter().filter(move |c| (started..ended).contains(&c.stamp_s));
    let ages = || running().map(|c| c.message.estimate_age_s);
    let link_ages = run.formation.iter().filter(|s| (started..ended).contains(&s.stamp_s)).filter_map(|s| {
        let index = s.message.platforms.iter().position(|p| p == name)?;
        s.message.link_age_s.get(index).copied()
    });
    let steps: Vec<_> = running().collect();
    let not_tracking_s = steps
        .windows(2)
        .filter(|w| w[0].message.mode != ControlStatus::MODE_TRACK)
        .map(|w| w[1].stamp_s - w[0].stamp_s)
        // Not sum(), which returns minus zero for an empty sequence.
        .fold(0.0, |total, dt| total + dt);
    PlatformSummary {
        name: name.to_owned(),
        pointing_error_rms_rad: rms(pointing),
        estimator_error_rms_rad: rms(estimator.iter().map(|(_, e)| e.norm())),
        estimator_heading_error_rms_rad: rms(estimator.iter().map(|(_, e)| e.z)),
        estimator_inclination_error_rms_rad: rms(estimator.iter().map(|(_, e)| e.x.hypot(e.y))),
        gas_used_kg: data.control.last().map_or(f64::NAN, |c| c.message.gas_used_kg),
        jet_on_time_s: data.thrusters.last().map_or(f64::NAN, |t| t.message.total_on_time_s.iter().sum()),
        wheel_speed_max_rad_s: maximum(data.wheels.iter().flat_map(|w| &w.message.velocity).map(|v| v.abs())),
        alpha_min: running().map(|c| c.message.alpha).fold(f64::NAN, f64::min),
        allocation_fallbacks: data.control.last().map_or(0, |c| c.message.allocation_fallbacks),
        sensor_to_command_p50_s: quantile(ages(), 0.5),
        sensor_to_command_p99_s: quantile(ages(), 0.99),
        link_age_max_s: maximum(link_ages),
        clock_offset_s: last_clock(run, name, |clocks| &clocks.offset_s),
        clock_uncertainty_s: last_clock(run, name, |clocks| &clocks.uncertainty_s),
        rejected_samples: data.estimate.last().map_or(0, |e| e.message.rejected_samples),
        not_tracking_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pointing_is_acquired_where_the_error_begins_to_stay_small() {
        let error = |(time_s, deg): (f64, f64)| RelativeError {
            time_s,
            total_rad: Vector3::x() * deg.to_radians(),
            estimator_rad: None,
            control_rad: Vector3::zeros(),
        };
        let errors = |degs: &[f64]| -> Vec<RelativeError> {
            degs.iter().enumerate().map(|(i, deg)| error((0.25 * i as f64, *deg))).collect()
        };
        // Small for a moment, then for good.
        assert_eq!(acquired_s(&errors(&[1.0, 0.05, 0.3, 0.09, 0.05, 0.02, 0.02, 0.02, 0.5])), 0.75);
        assert!(acquired_s(&errors(&[1.0, 0.05, 0.05, 0.05])).is_nan(), "not for a second");
        assert!(acquired_s(&[]).is_nan());
    }
}
