//! A small node that shows, and tests, everything a node gets from `whorl_ros`: it answers every
//! `attitude/estimate` of its platform with an `actuators/command` and publishes a reference on
//! its timer.
//!
//! ```bash
//! cargo run -p whorl_ros --example echo_node -- --ros-args -r __ns:=/whorl_1 \
//!     -p formation.platforms:=[whorl_1,whorl_2] -p gain:=0.5
//! ```

use std::process::ExitCode;
use std::time::Duration;

use whorl_msgs::whorl::{ActuatorCommand, AttitudeReference};
use whorl_msgs::{Message, PlatformId, Route, Service, Topic};
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Timestamp};
use whorl_params::{Reader, range};
use whorl_ros::{NodeOptions, RosError};

#[derive(Debug, Clone)]
struct Parameters {
    gain: f64,
    period_s: f64,
}

fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    Some(Parameters {
        gain: r.f64_or("gain", 1.0, range(0.0..=1.0), "what wheel torques are multiplied with"),
        period_s: r.fixed(|r| r.f64_or("period_s", 0.02, range(0.001..=1.0), "timer period [s]")),
    })
}

struct Echo {
    platform: PlatformId,
    parameters: Parameters,
    sequence: u64,
    finished: bool,
}

impl NodeCore for Echo {
    fn subscriptions(&self) -> Vec<Route> {
        vec![Route::platform(self.platform, Topic::AttitudeEstimate)]
    }

    fn publications(&self) -> Vec<Route> {
        vec![
            Route::platform(self.platform, Topic::ActuatorCommand),
            Route::platform(self.platform, Topic::AttitudeReference),
        ]
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(Duration::from_secs_f64(self.parameters.period_s))
    }

    fn services(&self) -> &'static [Service] {
        &[Service::StartExperiment, Service::AbortExperiment]
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        let command = Route::platform(self.platform, Topic::ActuatorCommand);
        match event {
            Event::Message { message: Message::AttitudeEstimate(estimate), .. } => {
                let mut answer =
                    ActuatorCommand { sequence: estimate.sequence, ..ActuatorCommand::default() };
                answer.header.stamp = estimate.header.stamp;
                answer.wheel_torque_n_m = vec![self.parameters.gain; 3];
                outputs.publish(command, answer);
            }
            Event::Message { .. } => {}
            Event::Timer => {
                self.sequence += 1;
                let mut reference =
                    AttitudeReference { sequence: self.sequence, ..AttitudeReference::default() };
                reference.header.stamp = now.into();
                outputs.publish(Route::platform(self.platform, Topic::AttitudeReference), reference);
            }
            Event::Request { service: Service::StartExperiment, argument } => {
                outputs.log(LogLevel::Info, format!("asked to start `{argument}`"));
                outputs.respond(argument != "refuse", format!("echo of {argument}"));
            }
            Event::Request { service: Service::AbortExperiment | Service::HoldExperiment, .. } => {
                outputs.respond(true, "finishing");
                self.finished = true;
            }
            Event::Interruption | Event::Woken => {}
            Event::Shutdown => {
                // The last word, which a test waits for.
                outputs
                    .publish(command, ActuatorCommand { sequence: u64::MAX, ..ActuatorCommand::default() });
            }
        }
    }

    fn finished(&self) -> bool {
        self.finished
    }
}

impl Configurable for Echo {
    type Parameters = Parameters;

    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        if parameters.gain == 0.125 {
            return Err("0.125 is refused by the core".into());
        }
        self.parameters = parameters.clone();
        Ok(())
    }
}

fn main() -> ExitCode {
    let options = NodeOptions::new("echo", "Answers estimates with commands.");
    whorl_ros::run_node(options, read, |context, parameters| {
        let platform = context.own_platform()?;
        Ok::<_, RosError>(Echo { platform, parameters, sequence: 0, finished: false })
    })
}
