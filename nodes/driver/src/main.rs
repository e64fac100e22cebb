//! The driver as a ROS 2 node.

mod recording;

use std::process::ExitCode;

use whorl_driver::{Backend, DriverCore, Parameters, parameters, start_devices};
use whorl_node::Node;
use whorl_ros::{NodeOptions, run_node};

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::Driver);
    run_node(options, parameters::read, |context, parameters: Parameters| {
        let recording = match &parameters.backend {
            Backend::Replay { source, channels } => {
                recording::read(source, channels.as_deref(), &parameters.name)?
            }
            _ => Vec::new(),
        };
        let devices = start_devices(&parameters)?;
        if let Some(devices) = &devices {
            context.wake_on(devices.waker()?);
        }
        anyhow::Ok(DriverCore::from_parameters(&parameters, recording, devices)?)
    })
}
