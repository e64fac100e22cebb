//! A node in its own process, seen over DDS on the loopback interface.
//!
//! Each test has a domain of its own, so that they may run at the same time. The node is the
//! example `echo_node`, which cargo builds along unless it is told `--test node`.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use std::io::Read;
use std::net::Ipv4Addr;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use whorl_msgs::diagnostic_msgs::DiagnosticStatus;
use whorl_msgs::topics::ExperimentResponse;
use whorl_msgs::whorl::srv::{AbortExperimentRequest, StartExperimentRequest};
use whorl_msgs::whorl::{ActuatorCommand, AttitudeEstimate};
use whorl_msgs::{Message, MessageType, PlatformId, Route, Topic};
use whorl_params::Value;
use whorl_ros::environment::Network;
use whorl_ros::{
    DiscoveredEndpoint, EndpointQos, NodeList, ParameterClient, Participant, RawReader, RawWriter,
    ServiceClient,
};
use whorl_tests::Domain;

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];
const LONG: Duration = Duration::from_secs(60);

struct Node(Child);

impl Node {
    fn command(domain: u16) -> Command {
        // The example lies beside the test: target/<profile>/{deps,examples}.
        let test = std::env::current_exe().unwrap();
        let example = test.parent().unwrap().parent().unwrap().join("examples/echo_node");
        let mut command = Command::new(example);
        command.env_clear().env("ROS_DOMAIN_ID", domain.to_string()).stderr(Stdio::piped());
        command.args(["--ros-args", "-r", "__ns:=/whorl_1", "-p", "formation.platforms:=[whorl_1,whorl_2]"]);
        command
    }

    fn start(domain: u16) -> Self {
        Self(Self::command(domain).spawn().unwrap())
    }

    fn signal(&self, name: &str) {
        let status = Command::new("kill").args([name, &self.0.id().to_string()]).status().unwrap();
        assert!(status.success());
    }

    /// Exit code of a process that is about to end.
    fn wait(&mut self) -> Option<i32> {
        until("the node to end", || self.0.try_wait().unwrap()).code()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn until<T>(what: &str, mut attempt: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(value) = attempt() {
            return value;
        }
        assert!(begin.elapsed() < LONG, "waited {LONG:?} for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn route(topic: Topic) -> Route {
    if topic.info().per_platform { Route::platform(PlatformId(0), topic) } else { Route::shared(topic) }
}

fn reader(participant: &Participant, topic: Topic) -> RawReader {
    let info = topic.info();
    let name = route(topic).name(&PLATFORMS).unwrap();
    participant.reader(&name, info.message_type.name(), info.qos.into()).unwrap()
}

fn writer(participant: &Participant, topic: Topic) -> RawWriter {
    let info = topic.info();
    let name = route(topic).name(&PLATFORMS).unwrap();
    participant.writer(&name, info.message_type.name(), info.qos.into()).unwrap()
}

fn encoded(message: impl Into<Message>) -> Vec<u8> {
    let mut bytes = Vec::new();
    message.into().encode_into(&mut bytes).unwrap();
    bytes
}

fn take_command(reader: &RawReader) -> Option<ActuatorCommand> {
    reader.drain_notifications();
    let sample = reader.take().unwrap()?;
    match Message::decode(MessageType::ActuatorCommand, &sample.bytes).unwrap() {
        Message::ActuatorCommand(command) => Some(command),
        other => panic!("{other:?}"),
    }
}

/// Sends estimates until one is answered, and returns the answer.
fn converse(estimates: &RawWriter, commands: &RawReader, sequence: u64) -> ActuatorCommand {
    let mut estimate = AttitudeEstimate { sequence, ..AttitudeEstimate::default() };
    estimate.header.stamp.sec = 7;
    let bytes = encoded(estimate);
    until("an answer", || {
        estimates.publish(&bytes).unwrap();
        std::thread::sleep(Duration::from_millis(5));
        take_command(commands)
    })
}

#[test]
fn every_type_of_message_crosses_between_two_participants() {
    let domain = Domain::take();
    let network = Network::localhost(domain.id);
    let (ours, theirs) = (Participant::new(&network).unwrap(), Participant::new(&network).unwrap());
    let mut kept = Vec::new();
    for &topic in Topic::ALL {
        let (reader, writer) = (reader(&ours, topic), writer(&theirs, topic));
        let sent = encoded(Message::default_of(topic.info().message_type));
        let sample = until(topic.info().name, || {
            writer.publish(&sent).unwrap();
            std::thread::sleep(Duration::from_millis(5));
            reader.drain_notifications();
            reader.take().unwrap()
        });
        // DDS pads the payload to a multiple of four bytes.
        assert_eq!(sample.bytes[..sent.len()], sent[..], "{topic:?}");
        assert!(sample.bytes.len() - sent.len() < 4);
        assert_eq!(sample.writer, writer.id());
        let age = sample.receive_time.seconds_since(sample.source_time.unwrap());
        assert!((0.0..1.0).contains(&age), "{age}");
        kept.push(writer);
    }
    let seen = ours.discovered_writers();
    let imu = seen.iter().find(|w| w.topic().as_deref() == Some("/whorl_1/imu/data_raw")).unwrap();
    assert_eq!(imu.type_name().as_deref(), Some("sensor_msgs/msg/Imu"));
    assert!(!imu.reliable);
}

#[test]
fn a_node_answers_ticks_and_ends_when_told() {
    let domain = Domain::take();
    let mut node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let estimates = writer(&participant, Topic::AttitudeEstimate);
    let commands = reader(&participant, Topic::ActuatorCommand);
    let references = reader(&participant, Topic::AttitudeReference);
    let answer = converse(&estimates, &commands, 42);
    assert_eq!((answer.sequence, answer.header.stamp.sec), (42, 7));
    assert_eq!(answer.wheel_torque_n_m, [1.0; 3]);

    // The timer: 50 Hz on a grid; counted over its own sequence, so that a loaded machine only
    // delays, never thins out.
    let mut stamps = Vec::new();
    until("a second of the timer", || {
        references.drain_notifications();
        while let Some(sample) = references.take().unwrap() {
            if let Message::AttitudeReference(r) =
                Message::decode(MessageType::AttitudeReference, &sample.bytes).unwrap()
            {
                stamps.push((r.sequence, whorl_node::Timestamp::from(r.header.stamp)));
            }
        }
        (stamps.len() > 50).then_some(())
    });
    let ((first, begin), (last, end)) = (stamps[0], stamps[stamps.len() - 1]);
    let period_s = end.seconds_since(begin) / (last - first) as f64;
    assert!((period_s - 0.02).abs() < 0.002, "{period_s}");

    // `ros2 node list` reads the same.
    let mut nodes = NodeList::new(&participant).unwrap();
    until("the node's name", || {
        nodes.nodes(&participant).unwrap().contains(&"/whorl_1/echo".to_owned()).then_some(())
    });

    while take_command(&commands).is_some() {}
    node.signal("-TERM");
    assert_eq!(node.wait(), Some(0));
    // What the core says at the end arrives.
    let last = until("the last command", || take_command(&commands).filter(|c| c.sequence == u64::MAX));
    assert!(last.wheel_torque_n_m.is_empty());
    until("the node to be off the list", || nodes.nodes(&participant).unwrap().is_empty().then_some(()));
}

#[test]
fn control_c_ends_a_node_too_and_a_finished_core_ends_itself() {
    let domain = Domain::take();
    let mut node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let commands = reader(&participant, Topic::ActuatorCommand);
    let estimates = writer(&participant, Topic::AttitudeEstimate);
    converse(&estimates, &commands, 1);
    node.signal("-INT");
    assert_eq!(node.wait(), Some(0));

    let mut node = Node::start(domain.id);
    let abort =
        ServiceClient::new(&participant, "/coordinator/abort", "whorl_msgs/srv/AbortExperiment").unwrap();
    let request = AbortExperimentRequest { reason: "done".into() };
    let answer: ExperimentResponse = abort.call(&participant, &request, LONG).unwrap();
    assert!(answer.success);
    assert_eq!(node.wait(), Some(0));
}

#[test]
fn a_node_that_was_stopped_and_continued_works_again() {
    let domain = Domain::take();
    let mut node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let commands = reader(&participant, Topic::ActuatorCommand);
    let estimates = writer(&participant, Topic::AttitudeEstimate);
    converse(&estimates, &commands, 1);
    node.signal("-STOP");
    std::thread::sleep(Duration::from_millis(200));
    node.signal("-CONT");
    std::thread::sleep(Duration::from_millis(200));
    while take_command(&commands).is_some() {}
    let answer = until("an answer to a new estimate", || {
        Some(converse(&estimates, &commands, 2)).filter(|answer| answer.sequence == 2)
    });
    assert_eq!(answer.sequence, 2);
    node.signal("-TERM");
    assert_eq!(node.wait(), Some(0));
}

#[test]
fn a_service_is_called_and_answers() {
    let domain = Domain::take();
    let _node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let start =
        ServiceClient::new(&participant, "/coordinator/start", "whorl_msgs/srv/StartExperiment").unwrap();
    for (experiment, success) in [("leader_follower", true), ("refuse", false)] {
        let request = StartExperimentRequest { experiment: experiment.into() };
        let answer: ExperimentResponse = start.call(&participant, &request, LONG).unwrap();
        assert_eq!(answer, ExperimentResponse { success, message: format!("echo of {experiment}") });
    }
}

/// As a client that asks right after it was created: the server knows the request before it knows the reader of answers.
#[test]
fn an_answer_waits_for_its_reader() {
    let domain = Domain::take();
    let _node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let service = EndpointQos::SERVICE;
    let request_type = "whorl_msgs::srv::dds_::StartExperiment_Request_";
    let answer_type = "whorl_msgs::srv::dds_::StartExperiment_Response_";
    let requests = participant.dds_writer("rq/coordinator/startRequest", request_type, service).unwrap();
    let servers = |list: Vec<DiscoveredEndpoint>, topic: &str| list.iter().any(|e| e.dds_topic == topic);
    until("the server", || {
        let found = servers(participant.discovered_readers(), "rq/coordinator/startRequest")
            && servers(participant.discovered_writers(), "rr/coordinator/startReply");
        found.then_some(())
    });
    // The own reader is among the discovered ones too: wait until the node has matched it.
    std::thread::sleep(Duration::from_millis(500));
    let mut experiment = vec![0, 1, 0, 0, 5, 0, 0, 0];
    experiment.extend(b"late\0");
    requests.publish(&experiment).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    let answers = participant.dds_reader("rr/coordinator/startReply", answer_type, service).unwrap();
    let answer = until("the answer", || {
        answers.drain_notifications();
        answers.take().unwrap()
    });
    let text = String::from_utf8_lossy(&answer.bytes).into_owned();
    assert!(text.contains("echo of late"), "{text}");
}

#[test]
fn parameters_are_read_set_in_range_and_refused_with_the_reason() {
    let domain = Domain::take();
    let _node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let client = ParameterClient::new(&participant, "/whorl_1/echo").unwrap();
    let names = client.list(&participant, LONG).unwrap();
    assert_eq!(names, ["gain", "period_s", "use_sim_time"]);
    let get = |name: &str| client.get(&participant, &[name], LONG).unwrap().remove(0);
    assert_eq!(get("gain"), Some(Value::Double(1.0)));
    assert_eq!(get("nonsense"), None);

    client.set(&participant, "gain", &Value::Double(0.5), LONG).unwrap();
    assert_eq!(get("gain"), Some(Value::Double(0.5)));
    let estimates = writer(&participant, Topic::AttitudeEstimate);
    let commands = reader(&participant, Topic::ActuatorCommand);
    assert_eq!(converse(&estimates, &commands, 1).wheel_torque_n_m, [0.5; 3]);

    for (name, value, expected) in [
        ("gain", Value::Double(1.5), "1"),
        ("gain", Value::Double(0.125), "refused by the core"),
        ("period_s", Value::Double(0.5), "when the node starts"),
        ("gian", Value::Double(0.5), "gain"),
    ] {
        let error = client.set(&participant, name, &value, LONG).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains(name), "{error}");
    }
    assert_eq!(get("gain"), Some(Value::Double(0.5)));
    let descriptions = client.describe(&participant, &["gain"], LONG).unwrap();
    assert_eq!(descriptions[0].range, Some((0.0, 1.0)));
}

#[test]
fn a_message_that_cannot_be_decoded_is_counted_reported_and_dropped() {
    let domain = Domain::take();
    let mut node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let estimates = writer(&participant, Topic::AttitudeEstimate);
    let commands = reader(&participant, Topic::ActuatorCommand);
    let diagnostics = reader(&participant, Topic::Diagnostics);
    converse(&estimates, &commands, 1);
    // A header with a string of 4 GiB, which is not there.
    estimates.publish(&[0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0xff, 0xff, 0xff, 0xff]).unwrap();
    let status = until("a warning in /diagnostics", || {
        diagnostics.drain_notifications();
        let sample = diagnostics.take().unwrap()?;
        let Message::DiagnosticArray(mut array) =
            Message::decode(MessageType::DiagnosticArray, &sample.bytes).unwrap()
        else {
            panic!("not a DiagnosticArray")
        };
        array.status.pop().filter(|status| status.level == DiagnosticStatus::WARN)
    });
    assert_eq!(status.name, "whorl_1/echo: transport");
    assert!(status.message.contains("/whorl_1/attitude/estimate"), "{}", status.message);
    assert!(status.values.iter().any(|v| v.value.contains("1 undecodable")));
    // And the node lives on.
    while take_command(&commands).is_some() {}
    assert_eq!(converse(&estimates, &commands, 2).sequence, 2);
    node.signal("-TERM");
    assert_eq!(node.wait(), Some(0));
}

#[test]
fn a_wrong_start_is_refused_with_what_is_wrong() {
    let domain = Domain::take();
    let refused = |arguments: &[&str], variable: Option<(&str, &str)>| {
        let mut command = Node::command(domain.id);
        command.args(arguments).envs(variable);
        let mut node = Node(command.spawn().unwrap());
        let code = node.wait();
        let mut text = String::new();
        node.0.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(code, Some(2), "{text}");
        text
    };
    for (arguments, variable, expected) in [
        (&["-p", "gain:=7"][..], None, "gain = 7"),
        (&["-p", "gian:=0.5"], None, "gain"),
        (&["--params-file", "/no/such.yaml"], None, "/no/such.yaml"),
        (&["-r", "__ns:=/elsewhere"], None, "/elsewhere"),
        (&["-p", "formation.platforms:=[]"], None, "formation.platforms"),
        (&["--", "stray"], None, "stray"),
        (&[], Some(("ROS_DOMAIN_ID", "233")), "ROS_DOMAIN_ID"),
        (&[], Some(("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")), "LOCALHOST"),
        (&[], Some(("ROS_SECURITY_ENABLE", "True")), "allowed: true, false"),
    ] {
        let text = refused(arguments, variable);
        assert!(text.contains(expected), "{expected}: {text}");
    }
}

#[test]
fn a_remapped_topic_is_found_under_its_new_name() {
    let domain = Domain::take();
    let mut command = Node::command(domain.id);
    command.args(["-r", "attitude/estimate:=/elsewhere/estimate", "-r", "__node:=renamed"]);
    let _node = Node(command.spawn().unwrap());
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let info = Topic::AttitudeEstimate.info();
    let estimates =
        participant.writer("/elsewhere/estimate", info.message_type.name(), info.qos.into()).unwrap();
    converse(&estimates, &reader(&participant, Topic::ActuatorCommand), 3);
    let mut nodes = NodeList::new(&participant).unwrap();
    until("the new name", || {
        nodes.nodes(&participant).unwrap().contains(&"/whorl_1/renamed".to_owned()).then_some(())
    });
}

/// Linux only, like the crate: the addresses that a node's sockets talk to are in /proc.
#[test]
fn nothing_leaves_the_loopback_interface() {
    let domain = Domain::take();
    let node = Node::start(domain.id);
    let participant = Participant::new(&Network::localhost(domain.id)).unwrap();
    let (estimates, commands) =
        (writer(&participant, Topic::AttitudeEstimate), reader(&participant, Topic::ActuatorCommand));
    converse(&estimates, &commands, 1);
    // No multicast group is joined on any interface but lo, and the announced addresses are
    // loopback addresses only.
    let groups = std::fs::read_to_string(format!("/proc/{}/net/igmp", node.0.id())).unwrap();
    let mut interface = String::new();
    for line in groups.lines().skip(1) {
        if !line.starts_with(['\t', ' ']) {
            interface = line.split_whitespace().nth(1).unwrap_or_default().to_owned();
        } else if line.trim_start().starts_with("0100FFEF") {
            assert_eq!(interface, "lo", "239.255.0.1 is joined on {interface}");
        }
    }
    for address in participant.addresses_of_peers() {
        assert!(address == Ipv4Addr::LOCALHOST, "{address}");
    }
}
