//! The recorder as a ROS 2 node.

mod recording;

use std::io::Write as _;
use std::process::ExitCode;

use whorl_node::Node;
use whorl_recorder::{Parameters, ReportingCore, parameters};
use whorl_ros::{NodeOptions, run_node};

use crate::recording::Recording;

fn main() -> ExitCode {
    let options = NodeOptions::of(Node::Recorder);
    let mut recording = None;
    let code = run_node(options, parameters::read, |context, parameters: Parameters| {
        let started = recording.insert(Recording::start(context, &parameters)?);
        // It records whether or not anybody reads this.
        let _ = writeln!(std::io::stdout(), "run directory: {}", started.run_directory().display());
        let run = started.run_directory().display().to_string();
        anyhow::Ok(ReportingCore::new(run, started.status()))
    });
    match recording.map(Recording::finish) {
        None | Some(Ok(())) => code,
        Some(Err(error)) => {
            let _ = writeln!(std::io::stderr(), "recorder: {error:#}");
            ExitCode::FAILURE
        }
    }
}
