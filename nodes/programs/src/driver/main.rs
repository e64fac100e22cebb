//! The driver as a ROS 2 node.

mod recording;

use std::process::ExitCode;
use std::sync::Arc;

use whorl_driver::{Backend, DriverCore, Parameters, StartedDevices, parameters, start_devices};
use whorl_node::Node;
use whorl_ros::{AmbientNetwork, NodeOptions, run_node};

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::Driver);
    run_node(options, parameters::read, |context, parameters: Parameters| {
        let recording = match &parameters.backend {
            Backend::Replay { source, channels } => {
                recording::read(source, channels.as_deref(), &parameters.name)?
            }
            _ => Vec::new(),
        };
        let devices = start_devices(&parameters, Arc::new(AmbientNetwork))?;
        if let Some(devices) = &devices {
            context.wake_on(devices.waker()?);
        }
        let began = context.clock().reading();
        let devices = devices.map(|devices| StartedDevices { devices, began });
        let secured = context.network().enclave.is_some();
        anyhow::Ok(DriverCore::from_parameters(&parameters, recording, devices)?.secured(secured))
    })
}
