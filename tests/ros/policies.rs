//! The shipped policies against what the nodes really use: a node that may not open a topic does not start.

use whorl_msgs::topics::Route;
use whorl_security::policy::grants;

use crate::support::cores::{PLATFORMS, cores};

#[test]
fn every_node_may_use_the_topics_that_its_core_asks_for() {
    let grants = grants(&PLATFORMS);
    for (node, core) in cores() {
        let grant = grants.iter().find(|grant| grant.enclave == node).unwrap();
        let name = |route: &Route| format!("rt{}", route.name(&PLATFORMS).unwrap());
        for route in core.subscriptions() {
            assert!(grant.subscribe.contains(&name(&route)), "{node} may not read {}", name(&route));
        }
        for route in core.publications() {
            assert!(grant.publish.contains(&name(&route)), "{node} may not write {}", name(&route));
        }
    }
}
