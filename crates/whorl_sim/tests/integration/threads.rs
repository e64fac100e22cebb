//! The same run on one thread and with nodes in threads of their own.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use whorl_msgs::topics::{Message, Route, Topic};
use whorl_node::{Event, LogLine, Timestamp};
use whorl_params::{Override, ParameterTree, standard_layers};
use whorl_sim::{NodeSet, Observer, run};

/// Everything that an observer sees, as text and bytes.
#[derive(Default)]
struct Seen {
    published: Vec<(Timestamp, Route, Vec<u8>)>,
    lines: Vec<String>,
    stepped: Vec<(Timestamp, String)>,
}

impl Observer for Seen {
    type Error = Infallible;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Infallible> {
        let mut bytes = Vec::new();
        message.encode_into(&mut bytes).unwrap();
        self.published.push((now, route, bytes));
        Ok(())
    }

    fn logged(&mut self, now: Timestamp, node: &str, line: &LogLine) {
        self.lines.push(format!("{} {node} {}", now.0, line.text));
    }

    fn stepping(&mut self, now: Timestamp, node: &str, _: &Event<'_>) {
        self.stepped.push((now, node.to_owned()));
    }
}

fn seen(threads: bool) -> Seen {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let experiment = folder.join("experiments/leader_follower_jets.yaml");
    let layers = standard_layers(&folder, &["whorl_1", "whorl_2"], Some(&experiment));
    // A jet that becomes weak, so that the model monitor has something to say, and a link that loses messages.
    let overrides = [
        "/whorl_1/driver:faults.weak.kind:=jet_weak",
        "/whorl_1/driver:faults.weak.jet:=jet_3",
        "/whorl_1/driver:faults.weak.thrust:=0.5",
        "/whorl_1/driver:faults.weak.start_s:=10.0",
        "/simulation:link.loss:=0.02",
        "/simulation:link.jitter_s:=0.002",
    ];
    let overrides: Vec<_> = overrides.iter().map(|o| Override::parse(o).unwrap()).collect();
    let tree = ParameterTree::load(&layers, &overrides).unwrap();
    let mut set = NodeSet::build_on_threads(&tree, 3, Timestamp(1_800_000_000_000_000_000), threads).unwrap();
    let mut seen = Seen::default();
    run(&mut set, Duration::from_secs(60), &mut seen, |_| ()).unwrap();
    seen
}

#[test]
fn threads_change_nothing() {
    let [one, several] = [false, true].map(seen);
    assert!(one.published.len() > 50_000);
    let fits = one.published.iter().filter(|(_, route, _)| route.topic == Topic::ModelFit).count();
    assert!(fits > 100, "{fits}");
    let differing = one.published.iter().zip(&several.published).find(|(a, b)| a != b);
    assert!(differing.is_none() && one.published.len() == several.published.len(), "{differing:?}");
    assert_eq!(one.lines, several.lines);
    assert_eq!(one.stepped, several.stepped);
}
