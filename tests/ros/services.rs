//! What ROS 2 tools expect: parameter services with ranges, `/rosout`, `/diagnostics`, `/tf`, the
//! coordinator's services, the list of nodes.

use std::time::Duration;

use whorl_msgs::diagnostic_msgs::DiagnosticArray;
use whorl_msgs::tf2_msgs::TFMessage;
use whorl_msgs::topics::{ExperimentResponse, Service, Topic};
use whorl_msgs::whorl::srv::{AbortExperimentRequest, StartExperimentRequest};
use whorl_msgs::whorl::{ControlStatus, FormationState};
use whorl_params::Value;
use whorl_ros::{EndpointQos, NodeList, ParameterClient, ParameterClientError, Participant, ServiceClient};

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::wait_for;
use crate::support::watch::{Watch, route};

const SOON: Duration = STARTUP;

/// Does not start by itself, and can be restarted.
const BY_HAND: &str = r#"
/coordinator:
  ros__parameters:
    experiment: {auto_start: false, exit_when_finished: false}
"#;

fn call<Q: serde::Serialize>(participant: &Participant, service: Service, request: &Q) -> ExperimentResponse {
    let client = ServiceClient::new(participant, service.name(), service.type_name()).unwrap();
    client.call(participant, request, SOON).unwrap()
}

fn wait_for_phase(watch: &Watch, phase: u8) {
    watch.wait_next::<FormationState>(
        &format!("phase {phase}"),
        route(0, Topic::FormationState),
        STARTUP,
        |m| m.phase == phase,
    );
}

#[test]
fn tools_find_what_they_expect_and_services_start_and_abort() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE, BY_HAND]);
    let watch = formation.watch();
    let participant = formation.participant();
    let rosout = participant.reader("/rosout", "rcl_interfaces/msg/Log", EndpointQos::ROSOUT).unwrap();
    formation.start_all();
    wait_for_phase(&watch, FormationState::PHASE_READY);

    parameters(&participant);
    nodes(&participant);
    watch.wait_next::<DiagnosticArray>(
        "diagnostics of each node",
        route(0, Topic::Diagnostics),
        SOON,
        |_| true,
    );
    for node in ["whorl_1: driver", "whorl_1: estimator", "whorl_1: local_control"] {
        watch.wait_next::<DiagnosticArray>(node, route(0, Topic::Diagnostics), SOON, |m| {
            m.status.iter().any(|s| s.name == node)
        });
    }
    watch.wait_next::<TFMessage>("/tf", route(0, Topic::Tf), SOON, |m| {
        m.transforms.iter().any(|t| t.child_frame_id == "whorl_1/base_link" && t.header.frame_id == "world")
    });

    // The name of the experiment is a check.
    let wrong = StartExperimentRequest { experiment: "another".to_owned() };
    let answer = call(&participant, Service::StartExperiment, &wrong);
    assert!(!answer.success && answer.message.contains("long_hold_alone"), "{answer:?}");
    let right = StartExperimentRequest { experiment: "long_hold_alone".to_owned() };
    let answer = call(&participant, Service::StartExperiment, &right);
    assert!(answer.success, "{answer:?}");
    let status = route(0, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>("tracking", status, SOON, |m| m.mode == ControlStatus::MODE_TRACK);
    let answer = call(&participant, Service::StartExperiment, &right);
    assert!(!answer.success && answer.message.contains("already"), "{answer:?}");

    let abort = AbortExperimentRequest { reason: "the test wants it".to_owned() };
    let answer = call(&participant, Service::AbortExperiment, &abort);
    assert!(answer.success, "{answer:?}");
    wait_for_phase(&watch, FormationState::PHASE_ABORTED);
    watch.wait_next::<ControlStatus>("safe mode after the abort", status, SOON, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING && m.reason == ControlStatus::REASON_ABORT
    });
    rosout.drain_notifications();
    let mut lines = Vec::new();
    while let Some(sample) = rosout.take().unwrap() {
        lines.push(String::from_utf8_lossy(&sample.bytes).into_owned());
    }
    assert!(lines.iter().any(|l| l.contains("aborted: the test wants it")), "{lines:?}");

    let again = call(&participant, Service::StartExperiment, &StartExperimentRequest::default());
    assert!(again.success, "{again:?}");
    watch.wait_next::<ControlStatus>("tracking again", status, SOON, |m| m.mode == ControlStatus::MODE_TRACK);
    formation.stop();
}

fn parameters(participant: &Participant) {
    let node = "/whorl_1/local_control";
    let client = ParameterClient::new(participant, node).unwrap();
    let name = "safe_mode.damping_time_constant_s";
    let names = client.list(participant, SOON).unwrap();
    assert!(names.iter().any(|n| n == name), "{names:?}");
    let described = client.describe(participant, &[name], SOON).unwrap().remove(0);
    assert_eq!(described.range, Some((0.1, 100.0)));
    assert!(described.description.contains("[s]") && !described.read_only, "{described:?}");

    let get = || client.get(participant, &[name], SOON).unwrap().remove(0);
    assert_eq!(get(), Some(Value::Double(2.0)));
    client.set(participant, name, &Value::Double(3.0), SOON).unwrap();
    assert_eq!(get(), Some(Value::Double(3.0)));
    match client.set(participant, name, &Value::Double(1000.0), SOON) {
        Err(ParameterClientError::Refused { reason, .. }) => {
            assert!(reason.contains("0.1") && reason.contains("100"), "{reason}");
        }
        other => panic!("a value out of range: {other:?}"),
    }
    let unknown = client.set(participant, "no_such_parameter", &Value::Double(1.0), SOON);
    assert!(matches!(unknown, Err(ParameterClientError::Refused { .. })), "{unknown:?}");
    assert_eq!(get(), Some(Value::Double(3.0)), "a refused value went through");
}

fn nodes(participant: &Participant) {
    let mut list = NodeList::new(participant).unwrap();
    let expected = ["/coordinator", "/whorl_1/driver", "/whorl_1/estimator", "/whorl_1/local_control"];
    wait_for("the list of nodes", SOON, || {
        let nodes = list.nodes(participant).unwrap();
        expected.iter().all(|node| nodes.iter().any(|n| n == node)).then_some(())
    });
}
