//! One verdict on a run: the same words on the terminal, on the page, in `summary.json` and behind the exit status.

use std::collections::BTreeMap;

use serde::Serialize;
use whorl_math::deg_from_rad;
use whorl_msgs::whorl::{FormationState, ModelFit};

use crate::data::{COUNTS, RunData};
use crate::metrics::{PlatformSummary, Summary};
use crate::platform::Numbers;

/// A fault that is over within this time \[s\] does not fail a run: authority and references take a moment to arrive.
const TOLERATED_S: f64 = 0.5;
/// Late timers per second of the run above which the computer counts as overloaded.
const LATE_PER_S: f64 = 1.0;
/// Share of lost messages that is worth a word.
const LOST_SHARE: f64 = 1e-3;

const OVERLOADED: &str = "this computer could not keep up, and says nothing about the experiment: end other programs and run it again. `whorl doctor` \
                          shows what keeps it busy, `whorl run --realtime` gives the nodes precedence, and `whorl simulate` needs no real time";

/// What is known of a run beside its messages.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Circumstances {
    /// The experiment's target for the relative pointing error in hold, RMS \[rad\], if it has one.
    pub target_rad: Option<f64>,
    /// Targets of every platform: key of [`measured`], and value in the unit of that.
    pub targets: Vec<(String, f64)>,
    /// Gas that each platform's tank holds \[kg\], by its name.
    pub gas_kg: BTreeMap<String, f64>,
    /// Why the recording is not complete, if it is not.
    pub incomplete: Option<String>,
    /// Messages recorded.
    pub messages: u64,
    /// Messages lost on the way to the recorder.
    pub lost: u64,
    /// Whether traffic was secured.
    pub secured: bool,
    /// What the recorder noted when its computer's clock was set, the first time.
    pub clock_set: Option<String>,
}

/// What a run came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Result {
    /// The experiment came to its end and did what it was meant to.
    Passed,
    /// It did not; the reasons say why.
    Failed,
    /// No experiment was started: a recording of platforms alone.
    NotJudged,
}

/// The verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// What the run came to.
    pub result: Result,
    /// Why it failed; empty when it did not.
    pub reasons: Vec<String>,
    /// What else is worth knowing.
    pub notes: Vec<String>,
    /// Time in safe mode, of the platform that was in it longest \[s\].
    pub safe_s: f64,
    /// Time without authority or with a stale reference, likewise \[s\].
    pub uncommanded_s: f64,
    /// Time after settling in which a reference was clipped at the tilt limit \[s\].
    pub clipped_s: f64,
    /// Timers of nodes that fired more than a period late.
    pub late_timers: u64,
    /// How often a driver switched off while the experiment ran, because commands came late or not at all.
    pub command_timeouts: u64,
    /// Whether the computer could not keep up with its deadlines.
    pub overloaded: bool,
    /// All in one line.
    pub line: String,
}

impl Verdict {
    /// Whether an exit status should say that the run failed.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.result == Result::Failed
    }

    /// What to do about a run that failed on a computer that could not keep up; `None` for every other.
    #[must_use]
    pub fn advice(&self) -> Option<&'static str> {
        (self.failed() && self.overloaded).then_some(OVERLOADED)
    }
}

/// Judges a run.
#[must_use]
pub fn judge(run: &RunData, summary: &Summary, circumstances: &Circumstances) -> Verdict {
    let longest = |seconds: fn(&Numbers) -> f64| {
        run.platforms.values().map(|data| seconds(&data.numbers)).fold(0.0, f64::max)
    };
    let safe_s = longest(|numbers| numbers.safe_s);
    let uncommanded_s = longest(|numbers| numbers.uncommanded_s);
    let clipped_s = clipped_s(run);
    let [late, timeouts] = COUNTS;
    let span = run.running;
    let late_timers = latest(run, (f64::NEG_INFINITY, f64::INFINITY), late);
    let command_timeouts = latest(run, (span.from_s, span.to_s), timeouts).saturating_sub(latest(
        run,
        (f64::NEG_INFINITY, span.from_s),
        timeouts,
    ));

    let mut reasons = Vec::new();
    match summary.outcome.as_str() {
        // One that nobody started is a recording.
        "finished" | "ready" => {}
        "aborted" => reasons.push(match aborted_for(run) {
            Some(why) => format!("the experiment was aborted: {why}"),
            None => "the experiment was aborted".to_owned(),
        }),
        phase => reasons.push(format!("the experiment did not end: it was in phase {phase}")),
    }
    let mut fault = |seconds: f64, what: &str| {
        if seconds > TOLERATED_S {
            reasons.push(format!("{what} for {seconds:.1} s"));
        }
    };
    fault(safe_s, "safe mode");
    fault(uncommanded_s, "no authority or a stale reference");
    fault(clipped_s, "reference clipped at the tilt limit");
    let mut notes = Vec::new();
    for pair in &summary.pairs {
        let error_deg = deg_from_rad(pair.relative_error_rms_rad);
        let of = format!("{} to {}", pair.follower, pair.leader);
        match circumstances.target_rad {
            _ if pair.hold_s <= 0.0 => {}
            Some(target_rad) if pair.relative_error_rms_rad <= target_rad => {
                notes.push(format!("target met: {of} {error_deg:.3} deg of {:.3}", deg_from_rad(target_rad)));
            }
            // An error that is not known has not met its target.
            Some(target_rad) => {
                let found = match &circumstances.clock_set {
                    _ if error_deg.is_finite() => format!("{error_deg:.3} deg"),
                    // Errors compare messages by their stamps.
                    Some(said) => format!("unknown, as {said}"),
                    None => "unknown".to_owned(),
                };
                reasons
                    .push(format!("target missed: {of} {found}, target {:.3} deg", deg_from_rad(target_rad)));
            }
            None => {}
        }
    }
    for (key, target) in &circumstances.targets {
        for platform in &summary.platforms {
            let Some((found, what, unit)) = measured(platform, key) else { continue };
            let text = format!("{}: {what} {found:.3} {unit}", platform.name);
            if found <= *target {
                notes.push(format!("target met: {text} of {target}"));
            } else {
                reasons.push(format!("target missed: {text}, target {target}"));
            }
        }
    }
    for (name, data) in &run.platforms {
        let said = data.fit.iter().rev().find(|fit| fit.message.state == ModelFit::STATE_MISMATCH);
        if let Some(fit) = said {
            notes.push(format!("{name} {}", fit.message.in_words()));
        }
        if let Some(empty_s) = data.tank.empty_since_s() {
            reasons.push(format!("{name}: the tank was empty after {empty_s:.1} s"));
        }
        let holds_kg = circumstances.gas_kg.get(name).copied().unwrap_or(f64::INFINITY);
        let used_kg = data.numbers.gas_used_kg;
        if used_kg > holds_kg {
            let (used, holds) = (used_kg * 1e3, holds_kg * 1e3);
            reasons.push(format!("{name}: {used:.1} g of gas used, by the model, of a tank of {holds:.1} g"));
        }
    }
    if let Some(why) = &circumstances.incomplete {
        reasons.push(format!("the recording is not complete: {why}"));
    }
    if let Some(said) = &circumstances.clock_set
        && !reasons.iter().any(|reason| reason.contains(said.as_str()))
    {
        notes.push(format!("{said}: what was measured before and after does not fit together"));
    }
    let overloaded = late_timers as f64 > LATE_PER_S * summary.duration_s;
    if overloaded {
        notes.push(format!("this computer was overloaded: {late_timers} deadlines missed"));
    } else if late_timers > 0 {
        notes.push(format!("{late_timers} deadlines missed"));
    }
    if command_timeouts > 0 {
        // The gate waits for one stall longer there (`whorl_driver::gate`).
        let secured = if circumstances.secured {
            "; secured, the DDS library stands still for 100 ms at a time, one of which the gate allows for"
        } else {
            ""
        };
        notes.push(format!("commands came late or not at all, {command_timeouts} times{secured}"));
    }
    if circumstances.lost as f64 > LOST_SHARE * circumstances.messages as f64 {
        notes.push(format!("{} of {} messages lost", circumstances.lost, circumstances.messages));
    }
    let not_started = run.formation.is_empty() || summary.outcome == "ready";
    let result = match (not_started, reasons.is_empty()) {
        (true, _) => Result::NotJudged,
        (false, true) => Result::Passed,
        (false, false) => Result::Failed,
    };
    let line = line(result, summary.duration_s, &reasons, &notes);
    Verdict {
        result,
        reasons,
        notes,
        safe_s,
        uncommanded_s,
        clipped_s,
        late_timers,
        command_timeouts,
        overloaded,
        line,
    }
}

fn line(result: Result, duration_s: f64, reasons: &[String], notes: &[String]) -> String {
    let head = match result {
        Result::Passed => format!("PASSED after {duration_s:.1} s"),
        Result::Failed => format!("FAILED: {}", reasons.join("; ")),
        Result::NotJudged => "not judged: no experiment was started".to_owned(),
    };
    if notes.is_empty() { head } else { format!("{head} ({})", notes.join("; ")) }
}

/// What a target of a platform is compared with, in words and with its unit; `None` for a key that nobody knows.
#[must_use]
pub fn measured(platform: &PlatformSummary, key: &str) -> Option<(f64, &'static str, &'static str)> {
    Some(match key {
        "estimator_deg" => (deg_from_rad(platform.estimator_error_rms_rad), "estimator error", "deg RMS"),
        "gas_g" => (platform.gas_used_kg * 1e3, "gas", "g"),
        "wheel_speed_rad_s" => (platform.wheel_speed_max_rad_s, "fastest wheel", "rad/s"),
        "latency_ms" => (platform.sensor_to_command_p99_s * 1e3, "sensor to command", "ms (99 %)"),
        _ => return None,
    })
}

/// Why the experiment was aborted, as the coordinator said last: in the formation's state ten times a second, in the diagnostics once.
fn aborted_for(run: &RunData) -> Option<&str> {
    let last = run.formation.last().map(|state| &state.message);
    let in_state =
        last.filter(|state| state.phase == FormationState::PHASE_ABORTED).map(|state| &*state.step);
    if let Some(why) = in_state.filter(|why| !why.is_empty()) {
        return Some(why);
    }
    let said = run.diagnostics.iter().rev().flat_map(|array| &array.message.status);
    said.filter(|status| status.name.ends_with(": experiment"))
        .find_map(|status| status.message.strip_prefix("aborted: "))
}

fn clipped_s(run: &RunData) -> f64 {
    // On the way to its first attitude a platform may be led along its limit.
    let asked = [FormationState::PHASE_MANOEUVRE, FormationState::PHASE_HOLD];
    let any = |s: &FormationState| asked.contains(&s.phase) && s.reference_clipped.contains(&true);
    let clipped = run.formation.windows(2).filter(|w| any(&w[0].message));
    clipped.map(|w| w[1].stamp_s - w[0].stamp_s).fold(0.0, |total, dt| total + dt)
}

/// The count of that name in the diagnostics, over all nodes, as each said it last within this time.
fn latest(run: &RunData, (from, to): (f64, f64), key: &str) -> u64 {
    let mut last = BTreeMap::new();
    let within = run.diagnostics.iter().filter(|array| (from..to).contains(&array.stamp_s));
    for status in within.flat_map(|array| &array.message.status) {
        let count = status.values.iter().find(|v| v.key == key);
        if let Some(count) = count.and_then(|v| v.value.parse::<u64>().ok()) {
            last.insert(status.name.as_str(), count);
        }
    }
    last.values().fold(0, |total: u64, count| total.saturating_add(*count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_msgs::std_msgs::Header;
    use whorl_msgs::topics::Message;
    use whorl_msgs::whorl::ControlStatus;

    use crate::Collector;
    use whorl_node::Timestamp;

    fn header(time_s: f64) -> Header {
        Header { stamp: Timestamp::from_seconds(1000.0 + time_s).into(), frame_id: String::new() }
    }

    fn add(run: &mut Collector, topic: &str, time_s: f64, message: impl Into<Message>) {
        let message: Message = message.into();
        run.add(topic, Timestamp::from_seconds(1000.0 + time_s).0, &message);
    }

    /// Ten seconds of an experiment; modes and clipping by time.
    fn run(last_phase: u8, status: impl Fn(f64) -> (u8, u8), clipped: impl Fn(f64) -> bool) -> Collector {
        let mut run = Collector::default();
        for k in 0..=100 {
            let time_s = f64::from(k) * 0.1;
            let phase = if k == 100 { last_phase } else { FormationState::PHASE_HOLD };
            let state = FormationState {
                header: header(time_s),
                phase,
                run_elapsed_s: time_s + 0.01,
                platforms: vec!["whorl_1".to_owned()],
                reference_clipped: vec![clipped(time_s)],
                ..FormationState::default()
            };
            add(&mut run, "/formation/state", time_s, state);
            let (mode, reason) = status(time_s);
            let status = ControlStatus { header: header(time_s), mode, reason, ..ControlStatus::default() };
            add(&mut run, "/whorl_1/control/status", time_s, status);
        }
        run
    }

    fn verdict(run: &Collector, circumstances: &Circumstances) -> Verdict {
        let run = &run.clone().finish();
        judge(run, &crate::metrics::summarise(run), circumstances)
    }

    const TRACKING: (u8, u8) = (ControlStatus::MODE_TRACK, ControlStatus::REASON_NONE);

    #[test]
    fn a_run_that_did_what_it_was_meant_to_passes() {
        let run = run(FormationState::PHASE_FINISHED, |_| TRACKING, |_| false);
        let verdict = verdict(&run, &Circumstances::default());
        assert_eq!((verdict.result, verdict.line.as_str()), (Result::Passed, "PASSED after 10.0 s"));
    }

    #[test]
    fn what_finished_without_tracking_has_failed() {
        let safe = |time_s: f64| {
            if time_s < 5.0 {
                TRACKING
            } else {
                (ControlStatus::MODE_SAFE_COAST, ControlStatus::REASON_ESTIMATE_STALE)
            }
        };
        let safe = run(FormationState::PHASE_FINISHED, safe, |_| false);
        let safe = verdict(&safe, &Circumstances::default());
        assert_eq!(safe.line, "FAILED: safe mode for 4.9 s");
        let stale = |_: f64| (ControlStatus::MODE_HOLD, ControlStatus::REASON_REFERENCE_STALE);
        let stale = run(FormationState::PHASE_FINISHED, stale, |_| false);
        assert!(verdict(&stale, &Circumstances::default()).line.contains("stale reference for 9.9 s"));
    }

    #[test]
    fn a_clipped_reference_an_abort_and_a_lost_recording_are_reasons() {
        let clipped = run(FormationState::PHASE_FINISHED, |_| TRACKING, |t| (2.0..5.0).contains(&t));
        let clipped = verdict(&clipped, &Circumstances::default());
        assert_eq!(clipped.line, "FAILED: reference clipped at the tilt limit for 3.0 s");
        let aborted = run(FormationState::PHASE_ABORTED, |_| TRACKING, |_| false);
        let lost = Circumstances {
            incomplete: Some("the disk was full".to_owned()),
            messages: 1000,
            lost: 20,
            ..Circumstances::default()
        };
        assert_eq!(
            verdict(&aborted, &lost).line,
            "FAILED: the experiment was aborted; the recording is not complete: the disk was full (20 of 1000 messages lost)"
        );
    }

    #[test]
    fn what_was_interrupted_is_not_called_finished_and_has_no_numbers_that_are_none() {
        let mut run = Collector::default();
        let state = FormationState {
            header: header(0.0),
            phase: FormationState::PHASE_SETTLE,
            platforms: vec!["whorl_1".to_owned()],
            ..FormationState::default()
        };
        add(&mut run, "/formation/state", 0.0, state);
        let target = Circumstances { target_rad: Some(0.002), ..Circumstances::default() };
        let verdict = verdict(&run, &target);
        assert_eq!(verdict.line, "FAILED: the experiment did not end: it was in phase settle");
        assert_eq!(
            judge(&RunData::default(), &crate::metrics::summarise(&RunData::default()), &target).result,
            Result::NotJudged
        );
    }

    #[test]
    fn a_clock_that_was_set_is_named_as_the_cause() {
        let run = run(FormationState::PHASE_FINISHED, |_| TRACKING, |_| false).finish();
        let mut summary = crate::metrics::summarise(&run);
        let pair = crate::PairSummary {
            follower: "whorl_2".to_owned(),
            leader: "whorl_1".to_owned(),
            hold_s: 5.0,
            relative_error_rms_rad: f64::NAN,
            ..Default::default()
        };
        summary.pairs = vec![pair];
        let said = "this computer's clock was set by -3600.000 s".to_owned();
        let target = Circumstances { target_rad: Some(0.002), ..Circumstances::default() };
        let plain = judge(&run, &summary, &target);
        assert!(
            plain.line.contains("whorl_2 to whorl_1 unknown, target") && !plain.line.contains("clock"),
            "{}",
            plain.line
        );
        let set = Circumstances { clock_set: Some(said.clone()), ..target };
        let named = judge(&run, &summary, &set);
        assert!(
            named.reasons[0].contains(&format!("unknown, as {said}")) && named.notes.is_empty(),
            "{}",
            named.line
        );
        // Where it did no harm it is a note.
        summary.pairs.clear();
        let harmless = judge(&run, &summary, &set);
        assert_eq!(harmless.result, Result::Passed);
        assert!(harmless.notes.iter().any(|note| note.starts_with(&said)), "{}", harmless.line);
    }

    #[test]
    fn an_abort_on_an_overloaded_computer_says_why_and_what_to_do() {
        let mut run = run(FormationState::PHASE_HOLD, |_| TRACKING, |_| false);
        let last = FormationState {
            header: header(10.1),
            phase: FormationState::PHASE_ABORTED,
            step: "whorl_1 did not follow its reference".to_owned(),
            platforms: vec!["whorl_1".to_owned()],
            ..FormationState::default()
        };
        add(&mut run, "/formation/state", 10.1, last);
        let well = verdict(&run, &Circumstances::default());
        assert_eq!(well.reasons, ["the experiment was aborted: whorl_1 did not follow its reference"]);
        assert_eq!((well.overloaded, well.advice()), (false, None));
        let values = vec![whorl_msgs::diagnostic_msgs::KeyValue {
            key: COUNTS[0].to_owned(),
            value: "875".to_owned(),
        }];
        let status = whorl_msgs::diagnostic_msgs::DiagnosticStatus {
            name: "driver".to_owned(),
            values,
            ..Default::default()
        };
        let array =
            whorl_msgs::diagnostic_msgs::DiagnosticArray { header: header(10.0), status: vec![status] };
        add(&mut run, "/diagnostics", 10.0, array);
        let late = verdict(&run, &Circumstances::default());
        assert_eq!(
            late.line,
            "FAILED: the experiment was aborted: whorl_1 did not follow its reference (this computer was overloaded: 875 deadlines missed)"
        );
        assert!(late.advice().is_some_and(|advice| advice.contains("whorl doctor")), "{late:?}");
    }

    /// A tank of 2e7 Pa that falls to a hundredth after six seconds, and gas beyond what the tank holds.
    #[test]
    fn an_empty_tank_fails_a_run() {
        let mut own = run(FormationState::PHASE_FINISHED, |_| TRACKING, |_| false);
        assert_eq!(verdict(&own, &Circumstances::default()).result, Result::Passed);
        for k in 0..100 {
            let time_s = f64::from(k) * 0.1;
            let fluid_pressure = if time_s < 5.95 { 2e7 - 3e6 * time_s } else { 2e5 };
            let pressure = whorl_msgs::sensor_msgs::FluidPressure {
                header: header(time_s),
                fluid_pressure,
                ..Default::default()
            };
            add(&mut own, "/whorl_1/tank_pressure", time_s, pressure);
        }
        let empty = verdict(&own, &Circumstances::default());
        assert_eq!(empty.reasons, ["whorl_1: the tank was empty after 5.9 s"]);

        let mut own = run(FormationState::PHASE_FINISHED, |_| TRACKING, |_| false);
        let last = ControlStatus { header: header(10.0), gas_used_kg: 0.3, ..ControlStatus::default() };
        add(&mut own, "/whorl_1/control/status", 10.0, last);
        let holds = Circumstances {
            gas_kg: BTreeMap::from([("whorl_1".to_owned(), 0.25)]),
            ..Circumstances::default()
        };
        assert_eq!(
            verdict(&own, &holds).reasons,
            ["whorl_1: 300.0 g of gas used, by the model, of a tank of 250.0 g"]
        );
        let asked = Circumstances { targets: vec![("gas_g".to_owned(), 100.0)], ..Circumstances::default() };
        assert_eq!(verdict(&own, &asked).reasons, ["target missed: whorl_1: gas 300.000 g, target 100"]);
    }
}
