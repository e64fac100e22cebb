//! `whorl arm` and `whorl disarm`: whether platforms may move.

use anyhow::bail;
use clap::Args;
use whorl_params::Value;
use whorl_ros::environment::Network;
use whorl_ros::{ParameterClient, ParameterClientError, Participant, RosError};
use whorl_security::policy::OPERATOR;

use crate::output::say;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Platforms, each of which has a driver that runs.
    #[arg(required = true, value_name = "PLATFORM")]
    platforms: Vec<String>,
}

/// Carries out `whorl arm` (`armed`) and `whorl disarm`. All platforms are asked, whatever one of them answers.
pub fn run(arguments: &Arguments, armed: bool) -> anyhow::Result<()> {
    set(&arguments.platforms, armed)
}

/// Arms or disarms these platforms.
pub fn set(platforms: &[String], armed: bool) -> anyhow::Result<()> {
    let network = Network::from_environment()?.secured(OPERATOR)?;
    let clients = |participant: &Participant| {
        let client = |platform: &String| ParameterClient::new(participant, &format!("/{platform}/driver"));
        platforms.iter().map(client).collect::<Result<Vec<_>, _>>()
    };
    let mut answers = Vec::new();
    Participant::ask(&network, clients, |participant, clients, time| {
        // Who has answered is not asked again where DDS got stuck meanwhile.
        for client in clients.iter().skip(answers.len()) {
            match client.set(participant, "armed", &Value::Bool(armed), time) {
                Err(ParameterClientError::Ros(error @ RosError::Stuck { .. })) => return Err(error),
                answer => answers.push(answer),
            }
        }
        Ok(())
    })?;
    let mut failed = Vec::new();
    for (platform, answer) in platforms.iter().zip(answers) {
        match answer {
            Ok(()) => say!("{platform}: {}", if armed { "armed" } else { "disarmed" }),
            Err(error) => failed.push(format!("{platform}: {error}")),
        }
    }
    if !failed.is_empty() {
        bail!("{}", failed.join("\n"));
    }
    Ok(())
}
