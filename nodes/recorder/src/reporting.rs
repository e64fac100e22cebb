//! The node that publishes the status of the recording.

use std::time::Duration;

use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::{Route, Topic};
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Timestamp};

use crate::{Parameters, Status};

/// Publishes [`Status`] once a second on `/diagnostics`, and logs when the recording stops.
pub struct ReportingCore<F> {
    status: F,
    run: String,
    last: Status,
    stopped: bool,
}

/// A recorder that has received nothing for this long reports it \[s\].
const SILENCE_S: f64 = 2.0;

impl<F: FnMut() -> Status + Send> ReportingCore<F> {
    /// `status` tells how the recording into the directory `run` goes.
    pub fn new(run: impl Into<String>, status: F) -> Self {
        Self { status, run: run.into(), last: Status::default(), stopped: false }
    }

    fn diagnostics(&mut self, now: Timestamp) -> DiagnosticArray {
        let status = (self.status)();
        let recorded = status.recorded - self.last.recorded.min(status.recorded);
        let lost = status.sequence_counts.lost.saturating_sub(self.last.sequence_counts.lost);
        let silent = status.last_sample.is_none_or(|last| now.seconds_since(last) > SILENCE_S);
        let (level, message) = if let Some(reason) = &status.stopped_by {
            (DiagnosticStatus::ERROR, format!("recording stopped: {reason}"))
        } else if status.refused > self.last.refused {
            let reason = status.last_refusal.clone().unwrap_or_default();
            (DiagnosticStatus::WARN, format!("messages are not recorded: {reason}"))
        } else if lost > 0 {
            (DiagnosticStatus::WARN, format!("{lost} messages lost in the last second"))
        } else if silent {
            (DiagnosticStatus::WARN, "no messages".to_owned())
        } else {
            (DiagnosticStatus::OK, format!("recording {recorded} messages per second"))
        };
        let value = |key: &str, value: String| KeyValue { key: key.to_owned(), value };
        let counts = status.sequence_counts;
        let values = vec![
            value("run_directory", self.run.clone()),
            value("messages", status.recorded.to_string()),
            value("messages_per_second", recorded.to_string()),
            value("bytes_written", status.bytes_written.to_string()),
            value("lost", counts.lost.to_string()),
            value("late", counts.late.to_string()),
            value("duplicates", counts.duplicates.to_string()),
            value("not_recorded", status.refused.to_string()),
        ];
        self.last = status;
        DiagnosticArray {
            header: Header { stamp: now.into(), frame_id: String::new() },
            status: vec![DiagnosticStatus {
                level,
                name: "recorder: bag".to_owned(),
                message,
                hardware_id: String::new(),
                values,
            }],
        }
    }
}

impl<F: FnMut() -> Status + Send> NodeCore for ReportingCore<F> {
    fn subscriptions(&self) -> Vec<Route> {
        Vec::new()
    }

    fn publications(&self) -> Vec<Route> {
        vec![Route::shared(Topic::Diagnostics)]
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(Duration::from_secs(1))
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        match event {
            Event::Timer => {
                let diagnostics = self.diagnostics(now);
                if let (Some(reason), false) = (&self.last.stopped_by, self.stopped) {
                    self.stopped = true;
                    outputs.log(LogLevel::Error, format!("recording stopped: {reason}"));
                }
                outputs.publish(Route::shared(Topic::Diagnostics), diagnostics);
            }
            Event::Message { .. }
            | Event::Request { .. }
            | Event::Woken
            | Event::Interruption
            | Event::Shutdown => {}
        }
    }
}

impl<F: FnMut() -> Status + Send> Configurable for ReportingCore<F> {
    type Parameters = Parameters;

    fn reconfigure(&mut self, _parameters: &Parameters) -> Result<(), String> {
        Err("a recording cannot be changed while it runs".to_owned())
    }
}
