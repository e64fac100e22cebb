//! The decentralised law on the platforms themselves: the formation's coordinator gives nothing and is not needed.

#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_msgs::whorl::{ControlStatus, FormationCommand, FormationState};
use whorl_node::{Event, LogLine, Timestamp};
use whorl_params::{Override, ParameterTree, layers_of_experiment, standard_layers};
use whorl_sim::{NodeSet, Observer, run};

#[derive(Default)]
struct Watch {
    stepping: String,
    /// Messages by node and topic.
    sent: BTreeMap<(String, &'static str), u32>,
    truth: BTreeMap<u16, UnitQuaternion<f64>>,
    states: Vec<FormationState>,
    modes: Vec<(f64, u16, u8)>,
    addressed: Vec<String>,
}

impl Observer for Watch {
    type Error = Infallible;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Infallible> {
        *self.sent.entry((self.stepping.clone(), route.topic.info().name)).or_default() += 1;
        match (route.platform, &**message) {
            (Some(PlatformId(id)), Message::AttitudeEstimate(m)) if route.topic == Topic::TruthState => {
                self.truth.insert(id, m.q_world_body.to_unit().unwrap());
            }
            (Some(PlatformId(id)), Message::ControlStatus(m)) => self.modes.push((now.seconds(), id, m.mode)),
            (_, Message::FormationState(m)) => self.states.push(m.clone()),
            (_, Message::FormationCommand(m)) if m.command == FormationCommand::COMMAND_TRACK => {
                self.addressed.push(m.header.frame_id.clone());
            }
            _ => {}
        }
        Ok(())
    }

    fn logged(&mut self, _: Timestamp, _: &str, _: &LogLine) {}

    fn stepping(&mut self, _: Timestamp, node: &str, _: &Event<'_>) {
        node.clone_into(&mut self.stepping);
    }
}

fn simulate(overrides: &[&str]) -> Watch {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let experiment = folder.join("experiments/decentralised_on_platforms.yaml");
    let overrides: Vec<_> = overrides.iter().map(|o| Override::parse(o).unwrap()).collect();
    let layers = standard_layers(&folder, &["whorl_1", "whorl_2"], Some(&experiment));
    let tree = ParameterTree::load(&layers, &overrides).unwrap();
    let mut set = NodeSet::build(&tree, 3, Timestamp(0)).unwrap_or_else(|e| panic!("{e}"));
    let mut watch = Watch::default();
    run(&mut set, Duration::from_secs(65), &mut watch, |_| ()).unwrap();
    watch
}

fn relative_error_deg(watch: &Watch) -> f64 {
    let relative = watch.truth[&0].inverse() * watch.truth[&1];
    let wanted = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 20_f64.to_radians());
    relative.angle_to(&wanted).to_degrees()
}

#[test]
fn platforms_keep_formation_and_the_observer_only_observes() {
    let watch = simulate(&[]);
    assert!(relative_error_deg(&watch) < 0.3, "{}", relative_error_deg(&watch));
    let sent = |node: &str, topic| watch.sent.get(&(node.to_owned(), topic)).copied().unwrap_or(0);
    assert_eq!(sent("/coordinator", "attitude/reference"), 0);
    assert_eq!(sent("/coordinator", "formation/command"), 0);
    assert!(sent("/coordinator", "formation/state") > 100);
    for platform in ["/whorl_1/coordinator", "/whorl_2/coordinator"] {
        assert!(sent(platform, "attitude/reference") > 2000);
        assert_eq!(sent(platform, "formation/state"), 0);
    }
    let named = |name: &str| watch.addressed.iter().filter(|a| *a == name).count();
    assert!(named("whorl_1") > 500 && named("whorl_2") > 500 && named("") == 0);
    let state = watch.states.last().unwrap();
    assert!(state.phase >= FormationState::PHASE_MANOEUVRE, "{state:?}");
}

#[test]
fn a_platform_that_is_cut_off_goes_on_alone_and_finds_back() {
    let watch = simulate(&[
        "/simulation:link.cuts.one.start_s:=30.0",
        "/simulation:link.cuts.one.length_s:=12.0",
        "/simulation:link.delay_s:=0.05",
    ]);
    assert!(relative_error_deg(&watch) < 0.3, "{}", relative_error_deg(&watch));
    // The one that knows the goal goes on; the other holds and stays under control.
    let tracked = |id: u16| {
        watch
            .modes
            .iter()
            .filter(|(t, i, _)| *i == id && (5.0..60.0).contains(t))
            .all(|(_, _, mode)| matches!(*mode, ControlStatus::MODE_TRACK | ControlStatus::MODE_HOLD))
    };
    assert!(tracked(0) && tracked(1));
}

/// A section for the coordinator on one platform is read by that one.
#[test]
fn a_platforms_own_coordinator_has_a_section_of_its_own() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let build = |experiment: &str| {
        let experiment = folder.join("experiments").join(experiment);
        let layers = layers_of_experiment(&folder, &experiment).unwrap();
        let mut texts: Vec<_> = layers
            .iter()
            .map(|path| (path.display().to_string(), std::fs::read_to_string(path).unwrap()))
            .collect();
        let own = "/whorl_1/coordinator:\n  ros__parameters:\n    waiting: {healthy_for_s: 2.5}\n";
        texts.push(("own.yaml".to_owned(), own.to_owned()));
        let texts: Vec<_> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        NodeSet::build(&ParameterTree::from_texts(&texts, &[]).unwrap(), 3, Timestamp(0))
    };
    let set = build("decentralised_on_platforms.yaml").unwrap_or_else(|e| panic!("{e}"));
    let section = |node: &str| {
        let rest = set.effective_parameters.split(&format!("{node}:\n")).nth(1).unwrap();
        rest.split("\n/").next().unwrap().to_owned()
    };
    assert!(section("/whorl_1/coordinator").contains("healthy_for_s: 2.5"));
    assert!(!section("/whorl_2/coordinator").contains("healthy_for_s: 2.5"));

    // Where no coordinator runs on a platform, it is a mistake.
    let Err(error) = build("leader_follower_short.yaml") else { panic!("accepted") };
    assert!(
        error.to_string().contains("own.yaml:2: section /whorl_1/coordinator matches no node"),
        "{error}"
    );
}
