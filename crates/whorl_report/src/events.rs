//! Events of a run: changes of phase, mode, health, link and diagnostics, in order of time.

use whorl_msgs::diagnostic_msgs::DiagnosticStatus;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus};

use crate::data::RunData;
use crate::metrics::phase_name;

/// One change.
#[derive(Debug, Clone, PartialEq)]
pub struct Happening {
    /// When \[s\].
    pub time_s: f64,
    /// Platform, node or "formation".
    pub who: String,
    /// What, in words.
    pub what: String,
    /// Whether it is a fault or a response to one.
    pub fault: bool,
}

/// Everything that changed.
#[must_use]
pub fn happenings(run: &RunData) -> Vec<Happening> {
    let mut list = Vec::new();
    let mut add = |time_s: f64, who: &str, what: String, fault: bool| {
        list.push(Happening { time_s, who: who.to_owned(), what, fault });
    };
    changes(
        run.formation.iter().map(|s| (s.stamp_s, (s.message.phase, s.message.step.clone()))),
        |t, (phase, step)| {
            let step = if step.is_empty() { String::new() } else { format!(", step \"{step}\"") };
            let aborted = phase == whorl_msgs::whorl::FormationState::PHASE_ABORTED;
            add(t, "formation", format!("phase {}{step}", phase_name(phase)), aborted);
        },
    );
    for (name, data) in &run.platforms {
        for (t, (mode, reason)) in &data.modes {
            let fault = !matches!(
                *mode,
                ControlStatus::MODE_IDLE | ControlStatus::MODE_TRACK | ControlStatus::MODE_EXCITE
            );
            add(*t, name, format!("control: {}{}", mode_name(*mode), reason_name(*reason)), fault);
        }
        for (t, health) in &data.health {
            let fault =
                matches!(*health, AttitudeEstimate::HEALTH_UNHEALTHY | AttitudeEstimate::HEALTH_DEGRADED);
            add(*t, name, format!("estimate: {}", health_name(*health)), fault);
        }
        for (t, failed) in &data.failed_jets {
            let failed: Vec<_> = (1..).zip(failed).filter(|(_, f)| **f).map(|(i, _)| i.to_string()).collect();
            if !failed.is_empty() {
                add(*t, name, format!("jets held at zero: {}", failed.join(", ")), true);
            }
        }
        let index =
            |state: &whorl_msgs::whorl::FormationState| state.platforms.iter().position(|p| p == name);
        let links = run
            .formation
            .iter()
            .filter_map(|s| Some((s.stamp_s, *s.message.link_ok.get(index(&s.message)?)?)));
        let clock = run.clocks.iter().filter_map(|s| {
            let index = s.message.platforms.iter().position(|p| p == name)?;
            Some((s.stamp_s, *s.message.applied_s.get(index)?))
        });
        changes(clock, |t, ahead_s| {
            // The first value is not a change.
            if ahead_s != 0.0 {
                let what =
                    format!("clock offset of {:+.1} ms measured: stamps are corrected by it", ahead_s * 1e3);
                add(t, name, what, false);
            }
        });
        changes(links, |t, ok| add(t, name, if ok { "link up" } else { "link lost" }.to_owned(), !ok));
    }
    diagnostics(run, &mut add);
    list.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    list
}

fn diagnostics(run: &RunData, add: &mut impl FnMut(f64, &str, String, bool)) {
    let all = || {
        run.diagnostics.iter().flat_map(|array| array.message.status.iter().map(move |s| (array.stamp_s, s)))
    };
    // What a node says before it is well for the first time is its start.
    let mut well_from_s = std::collections::BTreeMap::new();
    for (time_s, status) in all().filter(|(_, status)| status.level == DiagnosticStatus::OK) {
        well_from_s.entry(status.name.clone()).or_insert(time_s);
    }
    let mut level = std::collections::BTreeMap::new();
    for array in &run.diagnostics {
        for status in &array.message.status {
            let before = level.insert(status.name.clone(), status.level).unwrap_or(DiagnosticStatus::OK);
            if before != status.level {
                let word = match status.level {
                    DiagnosticStatus::OK => "ok",
                    DiagnosticStatus::WARN => "warning",
                    DiagnosticStatus::ERROR => "error",
                    _ => "stale",
                };
                let starts = status.level == DiagnosticStatus::WARN
                    && well_from_s.get(&status.name).is_some_and(|well_s| array.stamp_s < *well_s);
                let word = if starts { "at the start" } else { word };
                let what = format!("diagnostics {word}: {}", status.message);
                add(array.stamp_s, &status.name, what, status.level != DiagnosticStatus::OK && !starts);
            }
        }
    }
}

fn changes<T: PartialEq + Clone>(values: impl Iterator<Item = (f64, T)>, mut changed: impl FnMut(f64, T)) {
    let mut previous: Option<T> = None;
    for (time_s, value) in values {
        if previous.as_ref() != Some(&value) {
            previous = Some(value.clone());
            changed(time_s, value);
        }
    }
}

/// A mode of control in words.
#[must_use]
pub fn mode_name(mode: u8) -> &'static str {
    match mode {
        ControlStatus::MODE_IDLE => "idle",
        ControlStatus::MODE_TRACK => "tracking",
        ControlStatus::MODE_HOLD => "holding the last reference",
        ControlStatus::MODE_SAFE_DAMPING => "safe, damping the rate",
        ControlStatus::MODE_SAFE_COAST => "safe, coasting",
        ControlStatus::MODE_EXCITE => "excited, the reference is ignored",
        _ => "unknown mode",
    }
}

fn reason_name(reason: u8) -> &'static str {
    match reason {
        ControlStatus::REASON_NO_AUTHORITY => " (no authority)",
        ControlStatus::REASON_REFERENCE_STALE => " (reference stale)",
        ControlStatus::REASON_ESTIMATE_STALE => " (estimate stale)",
        ControlStatus::REASON_ESTIMATE_UNHEALTHY => " (estimate unhealthy)",
        ControlStatus::REASON_TILT_LIMIT => " (tilt near its stop)",
        ControlStatus::REASON_ABORT => " (abort)",
        ControlStatus::REASON_RATE_LIMIT => " (rate too high)",
        ControlStatus::REASON_EXCITATION_LIMIT => " (the excitation reached a limit)",
        ControlStatus::REASON_EXCITATION_UNKNOWN => " (no excitation of that name)",
        ControlStatus::REASON_COMMANDS_REFUSED => " (the driver does not carry out the commands)",
        _ => "",
    }
}

fn health_name(health: u8) -> &'static str {
    match health {
        AttitudeEstimate::HEALTH_INITIALISING => "initialising",
        AttitudeEstimate::HEALTH_OK => "ok",
        AttitudeEstimate::HEALTH_DEGRADED => "degraded",
        AttitudeEstimate::HEALTH_UNHEALTHY => "unhealthy",
        _ => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_changes_are_listed() {
        let mut seen = Vec::new();
        changes([(0.0, 1), (1.0, 1), (2.0, 3), (3.0, 1)].into_iter(), |t, v| seen.push((t, v)));
        assert_eq!(seen, [(0.0, 1), (2.0, 3), (3.0, 1)]);
    }
}
