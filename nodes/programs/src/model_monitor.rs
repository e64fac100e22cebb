//! The model monitor as a ROS 2 node.

use std::process::ExitCode;

use whorl_model_monitor::{ModelMonitorCore, parameters};
use whorl_node::Node;
use whorl_ros::{NodeOptions, run_node};

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::ModelMonitor);
    run_node(options, parameters::read, |_, parameters| ModelMonitorCore::new(parameters))
}
