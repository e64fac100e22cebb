//! The other end of `echo_node`: sends estimates at 100 Hz and tells when the answers stop and
//! when they return, with the round trip's percentiles at the end.
//!
//! ```bash
//! cargo run -p whorl_ros --example link_watch -- --ros-args -p formation.platforms:=[whorl_1,whorl_2]
//! ```

use std::process::ExitCode;
use std::time::Duration;

use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Timestamp};
use whorl_ros::{NodeOptions, RosError};

/// Silence that is worth a line [s].
const SILENCE_S: f64 = 0.1;

#[derive(Default)]
struct LinkWatch {
    sequence: u64,
    last_answer: Option<Timestamp>,
    silent: bool,
    round_trips_us: Vec<u32>,
}

impl NodeCore for LinkWatch {
    fn subscriptions(&self) -> Vec<Route> {
        vec![Route::platform(PlatformId(0), Topic::ActuatorCommand)]
    }

    fn publications(&self) -> Vec<Route> {
        vec![Route::platform(PlatformId(0), Topic::AttitudeEstimate)]
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(Duration::from_millis(10))
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        let since = |last: Timestamp| now.seconds_since(last);
        match event {
            Event::Message { message: Message::ActuatorCommand(answer), .. } => {
                let sent = Timestamp::from(answer.header.stamp);
                if sent != Timestamp(0) {
                    self.round_trips_us.push((now.seconds_since(sent) * 1e6) as u32);
                }
                if self.silent || self.last_answer.is_none() {
                    let gap = self.last_answer.map_or(0.0, since);
                    outputs.log(LogLevel::Info, format!("answers since now, after {gap:.3} s of silence"));
                }
                self.silent = false;
                self.last_answer = Some(now);
            }
            Event::Timer => {
                self.sequence += 1;
                let mut estimate =
                    AttitudeEstimate { sequence: self.sequence, ..AttitudeEstimate::default() };
                estimate.header.stamp = now.into();
                outputs.publish(Route::platform(PlatformId(0), Topic::AttitudeEstimate), estimate);
                if !self.silent && self.last_answer.is_some_and(|last| since(last) > SILENCE_S) {
                    self.silent = true;
                    outputs.log(LogLevel::Warn, "the answers have stopped");
                }
            }
            Event::Shutdown => {
                self.round_trips_us.sort_unstable();
                let count = self.round_trips_us.len();
                let at = |share: f64| self.round_trips_us.get((share * count as f64) as usize).copied();
                outputs.log(
                    LogLevel::Info,
                    format!(
                        "{count} round trips of {}: p50 {:?} us, p99 {:?} us, p99.9 {:?} us",
                        self.sequence,
                        at(0.5).unwrap_or(0),
                        at(0.99).unwrap_or(0),
                        at(0.999).unwrap_or(0)
                    ),
                );
            }
            Event::Message { .. } | Event::Request { .. } => {}
        }
    }
}

impl Configurable for LinkWatch {
    type Parameters = ();

    fn reconfigure(&mut self, (): &()) -> Result<(), String> {
        Ok(())
    }
}

fn main() -> ExitCode {
    let options = NodeOptions::new("link_watch", "Watches a link by its answers.");
    whorl_ros::run_node(options, |_| Some(()), |_, ()| Ok::<_, RosError>(LinkWatch::default()))
}
