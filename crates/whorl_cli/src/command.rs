//! `whorl start`, `whorl hold` and `whorl abort`: the coordinator's services.

use anyhow::bail;
use serde::Serialize;
use whorl_math::words::one_line;
use whorl_msgs::topics::{ExperimentResponse, Service};
use whorl_msgs::whorl::srv::{AbortExperimentRequest, HoldExperimentRequest, StartExperimentRequest};
use whorl_ros::environment::Network;
use whorl_ros::{Participant, ServiceClient};
use whorl_security::policy::OPERATOR;

use crate::output::say;

/// Carries out `whorl start`.
pub fn start(experiment: String) -> anyhow::Result<()> {
    say!("{}", request_start(experiment)?);
    Ok(())
}

/// Carries out `whorl abort`.
pub fn abort(reason: String) -> anyhow::Result<()> {
    say!("{}", request_abort(reason)?);
    Ok(())
}

/// Carries out `whorl hold`.
pub fn hold(reason: String) -> anyhow::Result<()> {
    say!("{}", request_hold(reason)?);
    Ok(())
}

/// Starts the experiment; an empty name is whichever is loaded. Returns what the coordinator says; its refusal is an
/// error.
pub fn request_start(experiment: String) -> anyhow::Result<String> {
    call(Service::StartExperiment, &StartExperimentRequest { experiment })
}

/// Ends the experiment, likewise.
pub fn request_abort(reason: String) -> anyhow::Result<String> {
    call(Service::AbortExperiment, &AbortExperimentRequest { reason })
}

/// Holds the experiment, likewise.
pub fn request_hold(reason: String) -> anyhow::Result<String> {
    call(Service::HoldExperiment, &HoldExperimentRequest { reason })
}

fn call(service: Service, request: &impl Serialize) -> anyhow::Result<String> {
    let client = |participant: &_| ServiceClient::new(participant, service.name(), service.type_name());
    let network = Network::from_environment()?.secured(OPERATOR)?;
    let response: ExperimentResponse = Participant::ask(&network, client, |participant, client, time| {
        client.call(participant, request, time)
    })?;
    let message = one_line(&response.message).into_owned();
    if response.success { Ok(message) } else { bail!(message) }
}
