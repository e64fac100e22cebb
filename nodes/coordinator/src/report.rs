//! The coordinator's messages.

use nalgebra::Vector3;
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::{AttitudeReference, ClockRequest, Excitation, FormationCommand, FormationState};
use whorl_node::Timestamp;

use crate::clock::ClockOffset;
use crate::link::PlatformLink;
use crate::parameters::Parameters;
use crate::run::{Leg, Run};
use crate::stage::Stage;

fn header(stamp: Timestamp, frame_id: &str) -> Header {
    Header { stamp: stamp.into(), frame_id: frame_id.to_owned() }
}

/// Authority, over one platform or (empty name) over all.
pub(crate) fn command(
    now: Timestamp,
    sequence: u64,
    command: u8,
    valid_until: Timestamp,
    platform: &str,
) -> FormationCommand {
    FormationCommand { header: header(now, platform), sequence, command, valid_until: valid_until.into() }
}

/// A platform's reference at `at`.
pub(crate) fn reference(
    at: Timestamp,
    sequence: u64,
    valid_until: Timestamp,
    leg: &Leg,
) -> AttitudeReference {
    let reference = &leg.shaped.reference;
    AttitudeReference {
        header: header(at, "world"),
        sequence,
        valid_until: valid_until.into(),
        q_world_reference: reference.q_world_reference.into(),
        omega_wr_r_rad_s: reference.omega_wr_r_rad_s.into(),
        omega_dot_wr_r_rad_s2: reference.omega_dot_wr_r_rad_s2.into(),
        mode: if leg.holding { AttitudeReference::MODE_HOLD } else { AttitudeReference::MODE_TRACK },
    }
}

/// Which of its own excitations a platform plays.
pub(crate) fn excitation(
    at: Timestamp,
    sequence: u64,
    valid_until: Timestamp,
    name: &str,
    elapsed_s: f64,
) -> Excitation {
    let valid_until = valid_until.into();
    Excitation { header: header(at, ""), sequence, name: name.to_owned(), elapsed_s, valid_until }
}

/// A request for the time, with the estimated clock offsets of the platforms.
pub(crate) fn clock_request(
    now: Timestamp,
    sequence: u64,
    parameters: &Parameters,
    links: &[PlatformLink],
) -> ClockRequest {
    let measured = |pick: fn(&ClockOffset) -> f64| {
        links.iter().map(|link| link.clock().measured().as_ref().map_or(f64::NAN, pick)).collect()
    };
    ClockRequest {
        header: header(now, &parameters.name()),
        sequence,
        platforms: parameters.platforms.clone(),
        offset_s: measured(|clock| clock.offset_s),
        uncertainty_s: measured(|clock| clock.uncertainty_s),
        applied_s: links.iter().map(|link| link.clock().applied_s()).collect(),
    }
}

/// The estimated clock offset of a platform's computer, for the log.
pub(crate) fn clock_in_words(link: &PlatformLink) -> String {
    let applied_ms = link.clock().applied_s() * 1e3;
    let uncertainty_ms = link.clock().measured().map_or(f64::NAN, |clock| clock.uncertainty_s * 1e3);
    format!(
        "the clock of {} is {:.1} ms {} of this one (known within {uncertainty_ms:.1} ms): stamps are translated",
        link.name(),
        applied_ms.abs(),
        if applied_ms < 0.0 { "behind" } else { "ahead" },
    )
}

/// `FormationState::PHASE_*`.
pub(crate) fn phase(parameters: &Parameters, stage: &Stage) -> u8 {
    match stage {
        Stage::Waiting { .. } => FormationState::PHASE_WAITING,
        Stage::Ready => FormationState::PHASE_READY,
        Stage::Running(run) => run.step(parameters).map_or(FormationState::PHASE_HOLD, |step| step.phase()),
        Stage::Finished { .. } => FormationState::PHASE_FINISHED,
        Stage::Aborted { .. } => FormationState::PHASE_ABORTED,
    }
}

fn step_text(parameters: &Parameters, stage: &Stage) -> String {
    match stage {
        Stage::Running(run) => {
            let name = run.step(parameters).map_or("", |step| step.name.as_str());
            if run.paused { format!("{name} (waiting)") } else { name.to_owned() }
        }
        Stage::Aborted { reason, .. } => reason.clone(),
        _ => String::new(),
    }
}

/// The formation's state.
pub(crate) fn state(
    now: Timestamp,
    sequence: u64,
    parameters: &Parameters,
    links: &[PlatformLink],
    stage: &Stage,
) -> FormationState {
    let run = stage.run();
    let platforms = 0..links.len();
    let relations: Vec<_> = platforms.clone().map(|p| run.and_then(|run| run.relation(p))).collect();
    let unknown = Vector3::repeat(f64::NAN);
    let error = |p: usize| run.and_then(|run| run.relative_error_rad(p)).unwrap_or(unknown).into();
    let planned_s: f64 = parameters.steps.iter().map(|step| step.duration_s).sum();
    let ended = match stage {
        Stage::Finished { at, .. } | Stage::Aborted { at, .. } => *at,
        _ => now,
    };
    FormationState {
        header: header(now, ""),
        sequence,
        experiment: parameters.experiment.name.clone(),
        law: law_name(parameters, stage).to_owned(),
        phase: phase(parameters, stage),
        step: step_text(parameters, stage),
        step_elapsed_s: run.map_or(0.0, |run| run.step_elapsed_s),
        run_elapsed_s: run.map_or(0.0, |run| ended.seconds_since(run.started).max(0.0)),
        run_length_s: planned_s + run.map_or(0.0, |run| run.paused_s),
        platforms: parameters.platforms.clone(),
        leader: relations
            .iter()
            .map(|relation| relation.and_then(|r| r.leader).and_then(|l| i32::try_from(l).ok()).unwrap_or(-1))
            .collect(),
        q_leader_platform: relations
            .iter()
            .map(|relation| relation.map(|r| r.q_leader_platform.into()).unwrap_or_default())
            .collect(),
        relative_error_rad: platforms.map(error).collect(),
        link_age_s: links.iter().map(|link| link.age_s(now)).collect(),
        link_ok: links.iter().map(|link| link.fresh(now, &parameters.link)).collect(),
        estimate_health: links.iter().map(PlatformLink::health).collect(),
        control_mode: links.iter().map(PlatformLink::control_mode).collect(),
        reference_clipped: (0..links.len())
            .map(|p| run.and_then(|run| run.legs.get(p)).is_some_and(|leg| leg.shaped.clipped))
            .collect(),
    }
}

fn law_name(parameters: &Parameters, stage: &Stage) -> &'static str {
    stage.run().map_or(parameters.law.name(), Run::law_name)
}

/// Once a second: the experiment, and the link to each platform.
pub(crate) fn diagnostics(
    now: Timestamp,
    parameters: &Parameters,
    links: &[PlatformLink],
    stage: &Stage,
    problems: &[String],
) -> DiagnosticArray {
    let value = |key: &str, value: String| KeyValue { key: key.to_owned(), value };
    let (level, message) = match stage {
        Stage::Aborted { reason, .. } => (DiagnosticStatus::ERROR, format!("aborted: {reason}")),
        Stage::Running(run) if run.paused => {
            (DiagnosticStatus::WARN, format!("waiting for {}", problems.join("; ")))
        }
        Stage::Waiting { .. } if !problems.is_empty() => {
            (DiagnosticStatus::WARN, format!("waiting for {}", problems.join("; ")))
        }
        Stage::Waiting { .. } => (DiagnosticStatus::OK, "waiting: all platforms are well".to_owned()),
        Stage::Ready => (DiagnosticStatus::OK, "ready".to_owned()),
        Stage::Running(_) => (DiagnosticStatus::OK, "running".to_owned()),
        Stage::Finished { .. } => (DiagnosticStatus::OK, "finished".to_owned()),
    };
    let seconds = |s: Option<f64>| s.map_or_else(String::new, |s| format!("{s:.4}"));
    let experiment = DiagnosticStatus {
        level,
        name: format!("{}: experiment", parameters.name()),
        message,
        hardware_id: String::new(),
        values: vec![
            value("experiment", parameters.experiment.name.clone()),
            value("law", law_name(parameters, stage).to_owned()),
            value("step", step_text(parameters, stage)),
            value(
                "broadcasts",
                stage.run().and_then(Run::broadcasts).map_or_else(String::new, |count| count.to_string()),
            ),
        ],
    };
    let link_status = |link: &PlatformLink| {
        let problem = link.estimate_problem(now, &parameters.link);
        let level = if problem.is_none() { DiagnosticStatus::OK } else { DiagnosticStatus::WARN };
        DiagnosticStatus {
            level,
            name: format!("{}: link to {}", parameters.name(), link.name()),
            message: problem.unwrap_or_else(|| "estimates arrive".to_owned()),
            hardware_id: link.name().to_owned(),
            values: vec![
                value("age_s", format!("{:.3}", link.age_s(now))),
                value("lost_estimates", link.lost_estimates.to_string()),
                value("dropped_invalid", link.dropped.invalid.to_string()),
                value("dropped_out_of_order", link.dropped.out_of_order.to_string()),
                value("dropped_late", link.dropped.late.to_string()),
                value("dropped_future", link.dropped.future.to_string()),
                value("clock_offset_s", seconds(link.clock().measured().map(|c| c.offset_s))),
                value("clock_uncertainty_s", seconds(link.clock().measured().map(|c| c.uncertainty_s))),
            ],
        }
    };
    let status = std::iter::once(experiment).chain(links.iter().map(link_status)).collect();
    DiagnosticArray { header: header(now, ""), status }
}
