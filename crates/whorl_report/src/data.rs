//! A run as its page and its numbers need it: bounded curves, sums and changes instead of messages.

use std::collections::{BTreeMap, BTreeSet};

use whorl_msgs::diagnostic_msgs::DiagnosticArray;
use whorl_msgs::topics::{Message, Topic};
use whorl_msgs::whorl::{ClockRequest, FormationState, ModelFit, ParameterEstimate};

use crate::frames::{Frame, Grid};
use crate::pair::{PairData, pairs_of, relative_errors};
use crate::platform::{PlatformData, Window};
use crate::times::{Holds, Recorded, Span};

/// Names of the counts in diagnostics that a verdict reads.
pub(crate) const COUNTS: [&str; 2] = ["timer firings more than a period late", "command timeouts"];
/// How far behind the newest message a run is evaluated \[s\]: what belongs together has arrived by then.
const BEHIND_S: f64 = 5.0;
/// How often \[s\].
const EVERY_S: f64 = 10.0;

/// A recorded run. Of an hour with two platforms it takes some 50 MB: what comes often (measurements, estimates, control)
/// is kept as curves of bounded length, sums and changes.
#[derive(Debug, Clone, Default)]
pub struct RunData {
    /// By platform name.
    pub platforms: BTreeMap<String, PlatformData>,
    /// Formation state.
    pub formation: Vec<Recorded<FormationState>>,
    /// Clock offsets of the platforms as measured by the formation's coordinator.
    pub clocks: Vec<Recorded<ClockRequest>>,
    /// Diagnostics of all nodes, where they changed.
    pub diagnostics: Vec<Recorded<DiagnosticArray>>,
    /// Time between the first and the last message \[s\].
    pub duration_s: f64,
    /// Messages on topics that the report does not use.
    pub other_messages: u64,
    /// Follower and leader of every pair that the formation state ever named.
    pub(crate) pairs: BTreeMap<(String, String), PairData>,
    /// Times of the frames of the replay.
    pub(crate) grid: Grid,
    /// From the start of the experiment to its end \[s\]; infinite while not known.
    pub(crate) running: Span,
    /// Hold phases.
    pub(crate) holds: Holds,
}

/// Takes the messages of a run, in order of log time, and keeps what [`RunData`] holds.
#[derive(Debug, Clone, Default)]
pub struct Collector {
    run: RunData,
    windows: BTreeMap<String, Window>,
    first_log_time_ns: Option<i64>,
    /// Offset of each platform's clock ahead of the coordinator's, as last applied \[s\].
    clock_ahead_s: BTreeMap<String, f64>,
    /// Formation states before this one are too old to command anything.
    formation_from: usize,
    evaluated_s: f64,
    /// Level and counts of each node's diagnostics, as last kept.
    diagnosed: BTreeMap<String, (u8, Vec<String>)>,
    /// Without what only pages draw: curves and frames.
    numbers_only: bool,
}

impl Collector {
    /// For [`crate::summarise`] alone: curves and frames of a page are left out.
    #[must_use]
    pub fn for_numbers() -> Self {
        Self { numbers_only: true, ..Self::default() }
    }

    /// Adds a message that was recorded on the full topic name at `log_time_ns`. Messages are
    /// expected in order of log time.
    pub fn add(&mut self, topic_name: &str, log_time_ns: i64, message: &Message) {
        let name = topic_name.trim_start_matches('/');
        if let Some(topic) = Topic::find(name, false) {
            return self.add_on(topic, None, log_time_ns, message);
        }
        let found = name.split_once('/').and_then(|(p, rest)| Topic::find(rest, true).map(|t| (p, t)));
        if let Some((platform, topic)) = found {
            return self.add_on(topic, Some(platform), log_time_ns, message);
        }
        self.arrived(log_time_ns);
        self.run.other_messages += 1;
    }

    /// The same for a topic of this platform, or one that all share.
    pub fn add_on(&mut self, topic: Topic, platform: Option<&str>, log_time_ns: i64, message: &Message) {
        let (first, log_time_s) = self.arrived(log_time_ns);
        let Some(platform) = platform else {
            return self.add_shared(topic, log_time_s, first, message);
        };
        if !self.run.platforms.contains_key(platform) {
            let data = PlatformData { numbers_only: self.numbers_only, ..PlatformData::default() };
            self.run.platforms.insert(platform.to_owned(), data);
            self.windows.insert(platform.to_owned(), Window::default());
        }
        let ahead_s = self.clock_ahead_s.get(platform).copied().unwrap_or(0.0);
        let data = self.run.platforms.get_mut(platform).zip(self.windows.get_mut(platform));
        let Some((data, window)) = data else { return };
        let of = |stamp| stamp_s(stamp, first).map_or(log_time_s, |s| s - ahead_s);
        match (topic, message) {
            (Topic::AttitudeEstimate, Message::AttitudeEstimate(m)) => {
                data.add_estimate(window, of(m.header.stamp), m);
            }
            (Topic::TruthState, Message::AttitudeEstimate(m)) => {
                data.add_truth(window, of(m.header.stamp), m);
            }
            (Topic::AttitudeReference, Message::AttitudeReference(m)) => {
                data.add_reference(window, of(m.header.stamp), m.q_world_reference);
            }
            (Topic::ControlStatus, Message::ControlStatus(m)) => {
                data.add_control(window, of(m.header.stamp), m);
            }
            (Topic::WheelState, Message::JointState(m)) => data.add_wheels(of(m.header.stamp), m),
            (Topic::GimbalState, Message::JointState(m)) => data.add_gimbals(of(m.header.stamp), m),
            (Topic::ThrusterState, Message::ThrusterState(m)) => {
                data.add_thrusters(window, of(m.header.stamp), m);
            }
            (Topic::TankPressure, Message::FluidPressure(m)) => {
                data.add_tank_pressure(of(m.header.stamp), m.fluid_pressure);
            }
            (Topic::ParameterEstimate, Message::ParameterEstimate(message)) => {
                let (stamp_s, message) = (of(message.header.stamp), message.clone());
                data.parameters.push(Recorded::<ParameterEstimate> { log_time_s, stamp_s, message });
            }
            (Topic::ModelFit, Message::ModelFit(message)) => {
                let (stamp_s, message) = (of(message.header.stamp), message.clone());
                data.fit.push(Recorded::<ModelFit> { log_time_s, stamp_s, message });
            }
            // Nothing on the page is drawn from these.
            (
                Topic::ImuRaw
                | Topic::VectorDirection
                | Topic::Battery
                | Topic::Temperature
                | Topic::ActuatorCommand,
                _,
            ) => {}
            _ => self.run.other_messages += 1,
        }
    }

    /// Goes on to the time of a message: when the first one was recorded \[ns\], and how long before this one \[s\].
    fn arrived(&mut self, log_time_ns: i64) -> (i64, f64) {
        let first = *self.first_log_time_ns.get_or_insert(log_time_ns);
        let log_time_s = seconds(log_time_ns - first);
        self.run.duration_s = self.run.duration_s.max(log_time_s);
        if log_time_s - BEHIND_S > self.evaluated_s + EVERY_S {
            self.evaluate(log_time_s - BEHIND_S);
            self.evaluated_s = log_time_s - BEHIND_S;
        }
        (first, log_time_s)
    }

    fn add_shared(&mut self, topic: Topic, log_time_s: f64, first: i64, message: &Message) {
        let of = |stamp| stamp_s(stamp, first).unwrap_or(log_time_s);
        match (topic, message) {
            (Topic::FormationState, Message::FormationState(message)) => {
                let stamp_s = of(message.header.stamp);
                let running = &mut self.run.running;
                if message.run_elapsed_s > 0.0 && running.from_s.is_infinite() {
                    running.from_s = stamp_s;
                }
                if message.phase >= FormationState::PHASE_FINISHED && running.to_s.is_infinite() {
                    running.to_s = stamp_s;
                }
                self.run.holds.add(stamp_s, message.phase == FormationState::PHASE_HOLD);
                self.run.formation.push(Recorded { log_time_s, stamp_s, message: message.clone() });
            }
            (Topic::FormationCommand, Message::FormationCommand(_)) => {}
            // The platforms' own coordinators publish offsets too, relative to their own clocks.
            (Topic::FormationClock, Message::ClockRequest(message))
                if message.header.frame_id == "coordinator" =>
            {
                let stamp_s = of(message.header.stamp);
                for (platform, ahead_s) in message.platforms.iter().zip(&message.applied_s) {
                    self.clock_ahead_s.insert(platform.clone(), *ahead_s);
                }
                self.run.clocks.push(Recorded { log_time_s, stamp_s, message: message.clone() });
            }
            (Topic::Diagnostics, Message::DiagnosticArray(message)) => {
                let stamp_s = of(message.header.stamp);
                self.add_diagnostics(log_time_s, stamp_s, message.clone());
            }
            _ => self.run.other_messages += 1,
        }
    }

    /// Keeps what changed: the level, and the counts that a verdict reads.
    fn add_diagnostics(&mut self, log_time_s: f64, stamp_s: f64, mut message: DiagnosticArray) {
        message.status.retain_mut(|status| {
            status.values.retain(|v| COUNTS.contains(&v.key.as_str()));
            let counts = status.values.iter().map(|v| v.value.clone()).collect();
            let now = (status.level, counts);
            if self.diagnosed.get(&status.name) == Some(&now) {
                return false;
            }
            self.diagnosed.insert(status.name.clone(), now);
            true
        });
        if !message.status.is_empty() {
            self.run.diagnostics.push(Recorded { log_time_s, stamp_s, message });
        }
    }

    /// The run, when all its messages have been added.
    #[must_use]
    pub fn finish(mut self) -> RunData {
        self.evaluate(f64::INFINITY);
        self.run
    }

    /// Evaluates what needs several topics, up to this time.
    fn evaluate(&mut self, until_s: f64) {
        let run = &mut self.run;
        let current = run.formation.get(self.formation_from..).unwrap_or_default();
        let named: BTreeSet<(String, String)> = current.iter().flat_map(|s| pairs_of(&s.message)).collect();
        for (follower, leader) in named {
            let (Some(f), Some(l)) = (self.windows.get(&follower), self.windows.get(&leader)) else {
                continue;
            };
            let errors = relative_errors(current, [&follower, &leader], [f, l], until_s);
            let new = || PairData { numbers_only: self.numbers_only, ..PairData::default() };
            let pair = run.pairs.entry((follower, leader)).or_insert_with(new);
            errors.for_each(|error| pair.add(&error, run.holds.contain(error.time_s)));
        }
        while self.formation_from < run.formation.len()
            && run.formation[self.formation_from].stamp_s < until_s - BEHIND_S
        {
            self.formation_from += 1;
        }
        let last = until_s.min(run.duration_s + 1e-9);
        while !self.numbers_only && run.grid.coarsen(last) {
            run.platforms.values_mut().for_each(|data| crate::frames::every_other(&mut data.frames));
        }
        let times: Vec<f64> = if self.numbers_only { vec![] } else { run.grid.until(last).collect() };
        for (name, data) in &mut run.platforms {
            let Some(window) = self.windows.get_mut(name) else { continue };
            data.frames.resize_with(run.grid.frames() - times.len(), Frame::default);
            data.frames.extend(times.iter().map(|t| window.frame(*t)));
            data.evaluate(window, until_s, run.running, &run.holds);
            window.forget(until_s);
        }
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

/// `None` for the zero stamp of a message that derives from no measurement.
fn stamp_s(stamp: whorl_msgs::builtin_interfaces::Time, first_ns: i64) -> Option<f64> {
    let ns = whorl_node::Timestamp::from(stamp).0;
    (ns != 0).then(|| seconds(ns - first_ns))
}
