//! A recording replayed through each core gives the outputs of the recording, to the bit.

use std::collections::BTreeMap;

use whorl_bag::{BagOptions, RunDescription, RunDirectory, RunWriter};
use whorl_coordinator::CoordinatorCore;
use whorl_driver::DriverCore;
use whorl_estimator::EstimatorCore;
use whorl_local_control::LocalControlCore;
use whorl_model_monitor::ModelMonitorCore;
use whorl_msgs::topics::{Message, Route};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};
use whorl_params::{ParameterTree, Reader};

use crate::support::machine::Load;
use crate::support::simulation::{Run, Told, encoded, parameters, simulate_with_journal};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

/// The messages of a bag by topic, in the order in which they were recorded.
fn recorded(run: &Run) -> BTreeMap<Route, Vec<Message>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    let description = RunDescription {
        platforms: run.platforms.clone(),
        simulated_time: true,
        ..RunDescription::default()
    };
    let mut writer = RunWriter::create_in(&path, description, Timestamp(0), BagOptions::default()).unwrap();
    for (at, route, message) in &run.published {
        writer.write_message(*route, *at, message).unwrap();
    }
    writer.finish(Timestamp(0)).unwrap();

    let routes: BTreeMap<String, Route> =
        run.published.iter().map(|(_, route, _)| (route.name(&PLATFORMS).unwrap(), *route)).collect();
    let mut by_route: BTreeMap<Route, Vec<Message>> = BTreeMap::new();
    let bag = RunDirectory::open(&path).unwrap().bag().unwrap();
    for message in bag.messages() {
        let message = message.unwrap();
        by_route.entry(routes[&message.topic.name]).or_default().push(message.decode().unwrap());
    }
    by_route
}

/// Feeds a core the events of the journal, with messages from the bag, and compares its outputs.
fn replay(node: &str, mut core: impl NodeCore, run: &Run, recorded: &BTreeMap<Route, Vec<Message>>) {
    let steps = &run.journal[node];
    let (mut outputs, mut compared) = (Outputs::default(), 0usize);
    for step in steps {
        let event = match &step.told {
            Told::Timer => Event::Timer,
            Told::Shutdown => Event::Shutdown,
            Told::Message(route, index) => {
                Event::Message { route: *route, message: &recorded[route][*index] }
            }
        };
        outputs.clear();
        core.step(step.now, event, &mut outputs);
        assert_eq!(outputs.messages.len(), step.said.len(), "{node} at {}: {:?}", step.now, step.told);
        for (publication, place) in outputs.messages.iter().zip(&step.said) {
            let (_, route, message) = &run.published[*place];
            assert_eq!(publication.route, *route, "{node} at {}", step.now);
            assert!(
                encoded(&publication.message) == encoded(message),
                "{node} at {}: {:?} became {message:?}",
                step.now,
                publication.message
            );
            compared += 1;
        }
    }
    // The model monitor speaks once a second, for half a minute.
    let least = if node.ends_with("model_monitor") { 50 } else { 500 };
    assert!(compared > least, "{node}: only {compared} messages were compared");
}

#[test]
fn every_core_answers_a_recording_as_it_answered_the_simulation() {
    let _share = Load::Computation.take();
    // Lost and late messages as well. The driver answers with its simulated platform, noise and all.
    let link = "/simulation: {ros__parameters: {link: {delay_s: 0.005, jitter_s: 0.005, loss: 0.02}}}";
    let run = simulate_with_journal(&parameters(&PLATFORMS, "leader_follower_short", &[link]), 9, 60.0);
    assert!(run.finished);
    let recorded = recorded(&run);

    // The cores are built from the parameters in force, as a run directory keeps them.
    let tree = ParameterTree::from_texts(&[("effective.yaml", &run.effective_parameters)], &[]).unwrap();
    for platform in PLATFORMS {
        let node = format!("/{platform}/driver");
        let read = whorl_driver::parameters::read(&mut Reader::new(&tree.for_node(&node))).unwrap();
        replay(&node, DriverCore::from_parameters(&read, Vec::new(), None).unwrap(), &run, &recorded);
        let node = format!("/{platform}/estimator");
        let read = whorl_estimator::parameters::read(&mut Reader::new(&tree.for_node(&node))).unwrap();
        replay(&node, EstimatorCore::new(read).unwrap(), &run, &recorded);
        let node = format!("/{platform}/local_control");
        let read = whorl_local_control::parameters::read(&mut Reader::new(&tree.for_node(&node))).unwrap();
        replay(&node, LocalControlCore::new(read).unwrap(), &run, &recorded);
        let node = format!("/{platform}/model_monitor");
        let read = whorl_model_monitor::parameters::read(&mut Reader::new(&tree.for_node(&node))).unwrap();
        replay(&node, ModelMonitorCore::new(read).unwrap(), &run, &recorded);
    }
    let read = whorl_coordinator::parameters::read(&mut Reader::new(&tree.for_node("/coordinator"))).unwrap();
    replay("/coordinator", CoordinatorCore::new(read).unwrap(), &run, &recorded);
}
