//! The numbers of a run.

use serde::Serialize;
use whorl_math::statistics::quantile;
use whorl_msgs::whorl::{ClockRequest, FormationState};

use crate::data::RunData;
use crate::pair::{PairData, pairs_of};
use crate::platform::PlatformData;
use crate::series::{maximum, rms};

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
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
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

/// Follower and leader of every pair that the last formation state names.
#[must_use]
pub fn pairs(run: &RunData) -> Vec<(String, String)> {
    run.formation.last().map(|last| pairs_of(&last.message).collect()).unwrap_or_default()
}

/// Computes the numbers of a run.
#[must_use]
pub fn summarise(run: &RunData) -> Summary {
    let hold_s = run.holds.intervals().map(|(start, end)| end - start).fold(0.0, |total, dt| total + dt);
    let nothing = PairData::default();
    let pair_summaries = pairs(run)
        .into_iter()
        // A platform of which nothing was recorded has no errors.
        .filter(|(follower, leader)| [follower, leader].iter().all(|p| run.platforms.contains_key(*p)))
        .map(|pair| {
            let errors = run.pairs.get(&pair).unwrap_or(&nothing);
            summarise_pair(pair, hold_s, errors)
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
        platforms: run.platforms.iter().map(|(name, data)| summarise_platform(run, name, data)).collect(),
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

fn summarise_pair((follower, leader): (String, String), hold_s: f64, errors: &PairData) -> PairSummary {
    PairSummary {
        follower,
        leader,
        acquired_s: errors.acquired.time_s(),
        hold_s,
        relative_error_rms_rad: rms(errors.held_rad.iter().copied()),
        relative_error_max_rad: maximum(errors.held_rad.iter().copied()),
        estimator_error_rms_rad: errors.held_estimator.value(),
        control_error_rms_rad: errors.held_control.value(),
        from_truth: errors.has_truth(),
    }
}

/// Latest known offset of a platform's clock; NaN if it was not measured.
fn last_clock(run: &RunData, name: &str, values: fn(&ClockRequest) -> &Vec<f64>) -> f64 {
    let of_platform = |clocks: &ClockRequest| {
        let index = clocks.platforms.iter().position(|p| p == name)?;
        values(clocks).get(index).copied().filter(|value| value.is_finite())
    };
    run.clocks.iter().rev().find_map(|c| of_platform(&c.message)).unwrap_or(f64::NAN)
}

fn summarise_platform(run: &RunData, name: &str, data: &PlatformData) -> PlatformSummary {
    let numbers = &data.numbers;
    // Before the start the controller idles; its numbers are not part of the run's.
    let link_ages = run.formation.iter().filter(|s| run.running.contains(s.stamp_s)).filter_map(|s| {
        let index = s.message.platforms.iter().position(|p| p == name)?;
        s.message.link_age_s.get(index).copied()
    });
    let [total, heading, inclination] = numbers.estimator.map(|rms| rms.value());
    PlatformSummary {
        name: name.to_owned(),
        pointing_error_rms_rad: numbers.pointing.value(),
        estimator_error_rms_rad: total,
        estimator_heading_error_rms_rad: heading,
        estimator_inclination_error_rms_rad: inclination,
        gas_used_kg: numbers.gas_used_kg,
        jet_on_time_s: numbers.jet_on_time_s,
        wheel_speed_max_rad_s: numbers.wheel_speed_max_rad_s,
        alpha_min: numbers.alpha_min,
        allocation_fallbacks: numbers.allocation_fallbacks,
        sensor_to_command_p50_s: quantile(numbers.ages_s.iter().copied(), 0.5),
        sensor_to_command_p99_s: quantile(numbers.ages_s.iter().copied(), 0.99),
        link_age_max_s: maximum(link_ages),
        clock_offset_s: last_clock(run, name, |clocks| &clocks.offset_s),
        clock_uncertainty_s: last_clock(run, name, |clocks| &clocks.uncertainty_s),
        rejected_samples: numbers.rejected_samples,
        not_tracking_s: numbers.not_tracking_s,
    }
}
