//! The node set in one process, with all outputs kept.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::UnitQuaternion;
use whorl_math::attitude_error;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, FormationState};
use whorl_node::{Event, LogLine, Timestamp};
use whorl_params::{ParameterTree, standard_layers};
use whorl_sim::{NodeSet, Observer, run};

use super::root;
use super::typed::Typed;
use super::watch::route;

/// The input of a node, in a form that can be replayed.
#[derive(Debug, Clone, PartialEq)]
pub enum Told {
    /// Its timer fired.
    Timer,
    /// The n-th message of this topic arrived.
    Message(Route, usize),
    /// The end.
    Shutdown,
}

/// One step of a node.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// When.
    pub now: Timestamp,
    /// Its input.
    pub told: Told,
    /// Its outputs, as indices in [`Run::published`].
    pub said: Vec<usize>,
}

/// A simulated run.
#[derive(Default)]
pub struct Run {
    /// Everything that was published, in order.
    pub published: Vec<(Timestamp, Route, Message)>,
    /// Log lines with the node's name.
    pub lines: Vec<(Timestamp, String, LogLine)>,
    /// The steps of every node, if they were asked for.
    pub journal: BTreeMap<String, Vec<Step>>,
    /// The parameters in force of every node.
    pub effective_parameters: String,
    /// Names of the platforms.
    pub platforms: Vec<String>,
    /// Whether the experiment ended by itself.
    pub finished: bool,
}

struct Recorder {
    run: Run,
    with_journal: bool,
    current: String,
    /// Places in `published` of the messages of a topic that this node has not been given yet are found
    /// by content: a link may lose and reorder them.
    by_route: BTreeMap<Route, Vec<usize>>,
}

impl Observer for Recorder {
    type Error = Infallible;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Infallible> {
        let place = self.run.published.len();
        self.run.published.push((now, route, Message::clone(message)));
        if self.with_journal {
            self.by_route.entry(route).or_default().push(place);
            if let Some(step) = self.run.journal.get_mut(&self.current).and_then(|steps| steps.last_mut()) {
                step.said.push(place);
            }
        }
        Ok(())
    }

    fn logged(&mut self, now: Timestamp, node: &str, line: &LogLine) {
        self.run.lines.push((now, node.to_owned(), line.clone()));
    }

    fn stepping(&mut self, now: Timestamp, node: &str, event: &Event<'_>) {
        if !self.with_journal {
            return;
        }
        let told = match event {
            Event::Timer => Told::Timer,
            Event::Shutdown => Told::Shutdown,
            Event::Message { route, message } => {
                let sent = self.by_route.get(route).map_or(&[][..], Vec::as_slice);
                let bytes = encoded(message);
                let newest = sent.iter().rposition(|place| encoded(&self.run.published[*place].2) == bytes);
                Told::Message(*route, newest.expect("a message that nobody sent"))
            }
            Event::Woken => panic!("nothing wakes a node between its events in a simulation"),
            Event::Request { .. } => panic!("nobody calls services in a simulation"),
            Event::Interruption => panic!("nothing interrupts a simulation"),
        };
        node.clone_into(&mut self.current);
        let steps = self.run.journal.entry(node.to_owned()).or_default();
        steps.push(Step { now, told, said: Vec::new() });
    }
}

/// CDR of a message: equal bytes are equal numbers, NaN included.
pub fn encoded(message: &Message) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.encode_into(&mut bytes).unwrap();
    bytes
}

/// Parameters of an experiment in `params/experiments/`, or of a text, with further layers above.
pub fn parameters(platforms: &[&str], experiment: &str, layers: &[&str]) -> ParameterTree {
    let folder = root().join("params");
    let named = folder.join("experiments").join(format!("{experiment}.yaml"));
    let files = standard_layers(&folder, platforms, named.is_file().then_some(named.as_path()));
    let mut texts: Vec<(String, String)> = files
        .iter()
        .map(|path| (path.display().to_string(), std::fs::read_to_string(path).unwrap()))
        .collect();
    if !named.is_file() {
        texts.push(("experiment".to_owned(), experiment.to_owned()));
    }
    texts.extend(layers.iter().enumerate().map(|(i, text)| (format!("layer {i}"), (*text).to_owned())));
    let texts: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    ParameterTree::from_texts(&texts, &[]).unwrap()
}

/// Runs a simulation to its end, at most for `longest_s`.
pub fn simulate(tree: &ParameterTree, seed: u64, longest_s: f64) -> Run {
    record(tree, seed, longest_s, false, Timestamp(0))
}

/// The same, from another time on.
pub fn simulate_from(start: Timestamp, tree: &ParameterTree, seed: u64, longest_s: f64) -> Run {
    record(tree, seed, longest_s, false, start)
}

/// The same, with a journal of every step of every node.
pub fn simulate_with_journal(tree: &ParameterTree, seed: u64, longest_s: f64) -> Run {
    record(tree, seed, longest_s, true, Timestamp(0))
}

fn record(tree: &ParameterTree, seed: u64, longest_s: f64, with_journal: bool, start: Timestamp) -> Run {
    let mut set = NodeSet::build(tree, seed, start).unwrap_or_else(|error| panic!("{error}"));
    let run_so_far = Run {
        effective_parameters: set.effective_parameters.clone(),
        platforms: set.platforms.clone(),
        ..Run::default()
    };
    let mut recorder =
        Recorder { run: run_so_far, with_journal, current: String::new(), by_route: BTreeMap::new() };
    let longest = Duration::from_secs_f64(longest_s);
    let Ok(outcome) = run(&mut set, longest, &mut recorder, |_| {});
    Run { finished: outcome.finished, ..recorder.run }
}

impl Run {
    /// Messages of one topic with the time they were sent.
    pub fn of<T: Typed>(&self, route: Route) -> impl DoubleEndedIterator<Item = (Timestamp, &T)> {
        self.published
            .iter()
            .filter(move |(_, r, _)| *r == route)
            .filter_map(|(at, _, m)| Some((*at, T::of(m)?)))
    }

    /// Everything published, as bytes.
    pub fn bytes(&self) -> Vec<u8> {
        let mut all = Vec::new();
        for (at, route, message) in &self.published {
            all.extend(at.0.to_le_bytes());
            all.extend(route.name(&self.platforms).unwrap().bytes());
            all.extend(encoded(message));
        }
        all
    }

    /// States of the formation.
    pub fn states(&self) -> impl DoubleEndedIterator<Item = (Timestamp, &FormationState)> {
        self.of(route(0, Topic::FormationState))
    }

    /// Times of the steps with this phase.
    pub fn in_phase(&self, phase: u8) -> Vec<(Timestamp, Timestamp)> {
        let mut spans: Vec<(Timestamp, Timestamp)> = Vec::new();
        let mut inside = false;
        for (at, state) in self.states() {
            match (state.phase == phase, inside, spans.last_mut()) {
                (true, true, Some(span)) => span.1 = at,
                (true, _, _) => spans.push((at, at)),
                _ => {}
            }
            inside = state.phase == phase;
        }
        spans
    }

    /// True attitudes of a platform by stamp.
    pub fn truth(&self, platform: u16) -> BTreeMap<Timestamp, UnitQuaternion<f64>> {
        self.of::<AttitudeEstimate>(route(platform, Topic::TruthState))
            .map(|(_, m)| (m.header.stamp.into(), m.q_world_body.to_unit().unwrap()))
            .collect()
    }

    /// Angle between where the second platform is and where it should be relative to the first, by the
    /// truth, at every instant of the holds [rad].
    pub fn relative_errors_in_hold(&self) -> Vec<f64> {
        let offset = self.states().next_back().unwrap().1.q_leader_platform[1].to_unit().unwrap();
        let (leader, follower) = (self.truth(0), self.truth(1));
        let mut errors = Vec::new();
        for (begin, end) in self.in_phase(FormationState::PHASE_HOLD) {
            for (stamp, q_leader) in leader.range(begin..=end) {
                if let Some(q_follower) = follower.get(stamp) {
                    errors.push(attitude_error(&(q_leader * offset), q_follower).norm());
                }
            }
        }
        errors
    }
}

/// Root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    assert!(!values.is_empty(), "nothing to average");
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}
