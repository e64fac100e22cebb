//! The estimator as a ROS 2 node.

use std::process::ExitCode;

use whorl_estimator::{EstimatorCore, parameters};
use whorl_ros::{NodeOptions, run_node};

fn main() -> ExitCode {
    let options = NodeOptions::new("estimator", "estimates attitude and gyro bias of one platform");
    run_node(options, parameters::read, |_, parameters| EstimatorCore::new(parameters))
}
