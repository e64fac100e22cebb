//! Local control of one platform as a ROS 2 node.

use std::process::ExitCode;

use whorl_local_control::{LocalControlCore, parameters};
use whorl_node::Node;
use whorl_ros::{NodeOptions, run_node};

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::LocalControl);
    run_node(options, parameters::read, |context, parameters| {
        LocalControlCore::new(parameters).map(|core| core.secured(context.network().enclave.is_some()))
    })
}
