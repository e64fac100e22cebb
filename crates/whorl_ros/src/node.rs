//! The whole `main` of a node.

use std::fmt::Display;
use std::process::ExitCode;

use whorl_node::Configurable;
use whorl_params::Reader;

use crate::context::{NodeContext, NodeOptions, WRONG_USAGE, context_from_command_line};
use crate::error::RosError;
use crate::log;
use crate::parameters;
use crate::runner::Runner;

/// Runs a core as a ROS 2 node until it has finished or SIGINT or SIGTERM comes: the whole
/// `main` of a node. `read` is the single definition of the node's parameters; `build` creates the
/// core from them.
///
/// Exit code 0 after a clean end, 2 for a wrong command line, environment or parameter, 1 when
/// the network fails.
pub fn run_node<C, E>(
    options: NodeOptions,
    read: impl Fn(&mut Reader<'_>) -> Option<C::Parameters> + 'static,
    build: impl FnOnce(&NodeContext, C::Parameters) -> Result<C, E>,
) -> ExitCode
where
    C: Configurable,
    E: Display,
{
    let context = match context_from_command_line(options) {
        Ok(context) => context,
        Err(code) => return code,
    };
    crate::launcher::end_with_launcher();
    let full_name = context.name().full();
    let (core, parameters) = match build_core(&context, &read, build) {
        Ok(built) => built,
        Err(error) => {
            log::complain(&full_name, &error);
            return WRONG_USAGE.into();
        }
    };
    match Runner::new(&context, core, parameters, Box::new(read)).and_then(Runner::run) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            log::complain(&full_name, &error);
            ExitCode::FAILURE
        }
    }
}

fn build_core<C: Configurable, E: Display>(
    context: &NodeContext,
    read: impl Fn(&mut Reader<'_>) -> Option<C::Parameters>,
    build: impl FnOnce(&NodeContext, C::Parameters) -> Result<C, E>,
) -> Result<(C, parameters::ParameterSet), RosError> {
    let own = context.parameters();
    let (values, descriptors) = parameters::read(&own, read)?;
    let core = build(context, values).map_err(|e| RosError::Core(e.to_string()))?;
    Ok((core, parameters::ParameterSet::new(own, descriptors)))
}
