//! Who may write and read what: one enclave for each node, with no more rights than it needs.
//!
//! The rows of `access` are the whole policy of topics. A node whose core declares more does not start where traffic is
//! secured (the tests of `ros::secure` start them). A node on a platform may use the topics of its own platform; the
//! coordinator, whose task is the formation, those of all platforms. A coordinator that runs on a platform commands that
//! platform only.

use std::collections::BTreeSet;

use whorl_msgs::{PlatformId, Route, Service, Topic};
use whorl_node::{Node, NodeInstance, node_set};

/// Enclave of programs that only look: `whorl monitor`, and the live status of `whorl run`.
pub const MONITOR: &str = "/monitor";
/// Enclave of a person's commands: `whorl start`, `whorl abort`, and `ros2 param` or `ros2 service`.
pub const OPERATOR: &str = "/operator";

/// The services that every node offers below its own name.
pub const NODE_SERVICES: [&str; 7] = [
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "get_type_description",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
];

/// What an enclave may do, in DDS names (`rt/whorl_1/imu/data_raw`). All else is denied.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grant {
    /// The enclave, which is the name of its node: `/whorl_1/driver`.
    pub enclave: String,
    /// Topics that it may write.
    pub publish: BTreeSet<String>,
    /// Topics that it may read.
    pub subscribe: BTreeSet<String>,
}

/// Who may write a topic of Whorl, and who needs to read it. Recorder, monitor and operator may read all.
fn access(topic: Topic) -> (&'static [Node], &'static [Node]) {
    use Node::{Coordinator, Driver, Estimator, LocalControl, ModelMonitor, Recorder};
    match topic {
        Topic::ImuRaw | Topic::WheelState | Topic::GimbalState | Topic::ThrusterState => {
            (&[Driver], &[Estimator, LocalControl, ModelMonitor])
        }
        Topic::VectorDirection => (&[Driver], &[Estimator]),
        Topic::Battery => (&[Driver], &[LocalControl, ModelMonitor]),
        Topic::TankPressure | Topic::Temperature => (&[Driver], &[ModelMonitor]),
        Topic::TruthState => (&[Driver], &[]),
        Topic::GateState => (&[Driver], &[LocalControl]),
        Topic::ActuatorCommand => (&[LocalControl], &[Driver]),
        Topic::BallastMoment => (&[LocalControl], &[Driver, Estimator, ModelMonitor]),
        Topic::ControlStatus => (&[LocalControl], &[Coordinator, ModelMonitor]),
        Topic::Clock => (&[LocalControl], &[Coordinator]),
        Topic::AttitudeEstimate => (&[Estimator], &[LocalControl, Coordinator, ModelMonitor]),
        Topic::ModelFit => (&[ModelMonitor], &[Coordinator]),
        Topic::ParameterEstimate | Topic::Tf => (&[Estimator], &[]),
        Topic::AttitudeReference | Topic::FormationCommand => (&[Coordinator], &[LocalControl, Coordinator]),
        Topic::Excitation | Topic::FormationClock => (&[Coordinator], &[LocalControl]),
        Topic::FormationState => (&[Coordinator], &[]),
        Topic::Diagnostics => (&[Driver, Estimator, LocalControl, ModelMonitor, Coordinator, Recorder], &[]),
    }
}

/// The grants of a formation: every node that its platforms and their coordinators can have, monitor and operator.
#[must_use]
pub fn grants<S: AsRef<str>>(platforms: &[S]) -> Vec<Grant> {
    let nodes: Vec<NodeInstance> =
        node_set(platforms, true).into_iter().filter(|instance| instance.node.info().is_program).collect();
    let mut grants: Vec<Grant> = nodes.iter().map(|node| of_node(node, platforms)).collect();
    let mut monitor = empty(MONITOR);
    monitor.subscribe.extend(EVERY_TOPIC.map(str::to_owned));
    let mut operator = empty(OPERATOR);
    operator.subscribe.extend(EVERY_TOPIC.map(str::to_owned));
    operator.publish.extend(NODE_TOPICS.map(str::to_owned));
    let offered = nodes.iter().flat_map(|node| services_of(node.node, node.platform, &node.name));
    for service in offered {
        operator.publish.insert(request(&service));
        operator.subscribe.insert(reply(&service));
    }
    grants.extend([monitor, operator]);
    grants
}

/// What every node writes: its log, changes of its parameters, its entry in the list of nodes.
const NODE_TOPICS: [&str; 3] = ["ros_discovery_info", "rt/parameter_events", "rt/rosout"];
/// What those who look may read.
const EVERY_TOPIC: [&str; 2] = ["ros_discovery_info", "rt/*"];

fn empty(enclave: &str) -> Grant {
    Grant { enclave: enclave.to_owned(), publish: BTreeSet::new(), subscribe: BTreeSet::new() }
}

fn of_node<S: AsRef<str>>(instance: &NodeInstance, platforms: &[S]) -> Grant {
    let NodeInstance { node, platform, name } = instance;
    let mut grant = empty(name);
    grant.publish.extend(NODE_TOPICS.map(str::to_owned));
    grant.subscribe.insert("ros_discovery_info".to_owned());
    for &topic in Topic::ALL {
        let (writers, readers) = access(topic);
        let names = |platform: Option<u16>| dds_names(topic, platform, platforms);
        if writers.contains(node) {
            grant.publish.extend(names(*platform));
        }
        if readers.contains(node) {
            // Whoever coordinates hears of all platforms, wherever it runs.
            grant.subscribe.extend(names(platform.filter(|_| *node != Node::Coordinator)));
        }
    }
    if *node == Node::Recorder {
        grant.subscribe.extend(EVERY_TOPIC.map(str::to_owned));
    }
    for service in services_of(*node, *platform, name) {
        grant.publish.insert(reply(&service));
        grant.subscribe.insert(request(&service));
    }
    grant
}

/// DDS names of a topic: of one platform, or of all where none is given.
fn dds_names<S: AsRef<str>>(topic: Topic, platform: Option<u16>, platforms: &[S]) -> Vec<String> {
    let routes: Vec<Route> = match (topic.info().per_platform, platform) {
        (false, _) => vec![Route::shared(topic)],
        (true, Some(platform)) => vec![Route::platform(PlatformId(platform), topic)],
        (true, None) => {
            (0u16..).zip(platforms).map(|(index, _)| Route::platform(PlatformId(index), topic)).collect()
        }
    };
    routes.iter().filter_map(|route| route.name(platforms)).map(|name| format!("rt{name}")).collect()
}

fn services_of(node: Node, platform: Option<u16>, name: &str) -> Vec<String> {
    let mut services: Vec<String> = NODE_SERVICES.iter().map(|service| format!("{name}/{service}")).collect();
    if node == Node::Coordinator && platform.is_none() {
        services.extend(Service::ALL.map(|s| s.name().to_owned()));
    }
    services
}

fn request(service: &str) -> String {
    format!("rq{service}Request")
}

fn reply(service: &str) -> String {
    format!("rr{service}Reply")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn writers_of(topic: &str) -> Vec<String> {
        let grants = grants(&["whorl_1", "whorl_2"]);
        grants.into_iter().filter(|g| g.publish.contains(topic)).map(|g| g.enclave).collect()
    }

    #[test]
    fn only_the_own_local_control_moves_a_platform() {
        assert_eq!(writers_of("rt/whorl_1/actuators/command"), ["/whorl_1/local_control"]);
        assert_eq!(writers_of("rt/whorl_2/ballast/moment"), ["/whorl_2/local_control"]);
    }

    #[test]
    fn only_coordinators_write_references_and_on_a_platform_only_its_own() {
        assert_eq!(writers_of("rt/whorl_1/attitude/reference"), ["/whorl_1/coordinator", "/coordinator"]);
        assert_eq!(
            writers_of("rt/formation/command"),
            ["/whorl_1/coordinator", "/whorl_2/coordinator", "/coordinator"]
        );
        assert_eq!(writers_of("rt/whorl_2/attitude/estimate"), ["/whorl_2/estimator"]);
    }

    #[test]
    fn nobody_may_write_by_a_pattern_and_those_who_look_write_nothing() {
        for grant in grants(&["a", "b", "c"]) {
            assert!(grant.publish.iter().all(|topic| !topic.contains(['*', '?', '['])), "{grant:?}");
            assert!(grant.enclave != MONITOR || grant.publish.is_empty());
        }
    }

    #[test]
    fn only_the_operator_asks_and_only_the_owner_answers() {
        let asks: Vec<String> = writers_of("rq/coordinator/startRequest");
        assert_eq!(asks, [OPERATOR]);
        assert_eq!(writers_of("rr/coordinator/startReply"), ["/coordinator"]);
        assert_eq!(writers_of("rq/whorl_1/driver/set_parametersRequest"), [OPERATOR]);
        assert_eq!(writers_of("rr/whorl_1/driver/set_parametersReply"), ["/whorl_1/driver"]);
    }
}
