//! The estimator as a ROS 2 node.

use std::process::ExitCode;

use whorl_estimator::{EstimatorCore, parameters};
use whorl_node::Node;
use whorl_ros::{NodeOptions, run_node};

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::Estimator);
    run_node(options, parameters::read, |_, parameters| EstimatorCore::new(parameters))
}
