//! The coordinator as a ROS 2 node.

mod keeping;

use std::process::ExitCode;

use whorl_coordinator::{CoordinatorCore, parameters};
use whorl_node::Node;
use whorl_ros::{NodeOptions, run_node};

use self::keeping::Keeping;

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::Coordinator);
    run_node(options, parameters::read, |context, parameters| {
        CoordinatorCore::new(parameters)
            .map(|core| Keeping::of(core.secured(context.network().enclave.is_some())))
    })
}
