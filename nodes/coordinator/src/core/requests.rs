//! Requests to the coordinator (start, hold, abort, stop), and its own requests for the time.

use whorl_msgs::topics::{Route, Topic};
use whorl_node::{LogLevel, Outputs, Timestamp};

use super::{CoordinatorCore, PERIOD};
use crate::clock::ticks_between_requests;
use crate::parameters::Role;
use crate::progress::Earlier;
use crate::report;
use crate::stage::Stage;

impl CoordinatorCore {
    /// Requests the time of every platform's computer, and publishes the estimated offsets.
    pub(super) fn ask_for_time(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let settings = &self.parameters.link;
        let hurry = self.links.iter().any(|link| link.clock().hardly_known() && link.fresh(now, settings));
        if self.ticks.is_multiple_of(ticks_between_requests(PERIOD, hurry)) {
            let message = report::clock_request(now, self.sequences.clock, &self.parameters, &self.links);
            self.sequences.clock += 1;
            outputs.publish(Route::shared(Topic::FormationClock), message);
        }
    }

    pub(super) fn request_start(&mut self, now: Timestamp, experiment: &str, outputs: &mut Outputs) {
        let name = self.parameters.experiment.name.clone();
        if !experiment.is_empty() && experiment != name {
            outputs.respond(false, format!("the experiment loaded is {name}, not {experiment}"));
            return;
        }
        if self.parameters.role == Role::Observer {
            outputs
                .respond(false, "every platform runs the law itself and starts when its neighbours are well");
            return;
        }
        let problems = self.current_problems(now);
        match &mut self.stage {
            Stage::Running(run) if run.held.is_some() => {
                run.held = None;
                outputs.log(LogLevel::Info, format!("{name} is held no longer"));
                outputs.respond(true, format!("{name} goes on"));
            }
            Stage::Running(_) => outputs.respond(false, format!("{name} is already running")),
            _ if !problems.is_empty() => {
                outputs.respond(false, format!("waiting for {}", problems.join("; ")));
            }
            _ => {
                if let Some(Earlier::GoesOn(progress, _)) = &mut self.earlier {
                    progress.held = None;
                }
                let at = self.tick_at.unwrap_or(now);
                match self.start(at, outputs) {
                    Ok(()) => outputs.respond(true, format!("{name} starts")),
                    Err(reason) => outputs.respond(false, reason),
                }
            }
        }
    }

    /// The sequence waits, as for a platform that does not move as its model says, until it is started again.
    pub(super) fn request_hold(&mut self, reason: &str, outputs: &mut Outputs) {
        if self.parameters.role == Role::Observer {
            outputs.respond(false, "every platform runs the law itself: the experiment can only be aborted");
            return;
        }
        let reason = if reason.is_empty() { "asked for by a service call" } else { reason };
        match &mut self.stage {
            Stage::Running(run) => {
                outputs.log(LogLevel::Warn, format!("held: {reason}"));
                run.held = Some(format!("a start (held: {reason})"));
                outputs.respond(true, "held: the references come to rest; start goes on");
            }
            _ => match &mut self.earlier {
                Some(Earlier::GoesOn(progress, _)) => {
                    progress.held = Some(format!("a start (held: {reason})"));
                    outputs.respond(true, "held: it goes on when it is started");
                }
                _ => outputs.respond(false, "no experiment is running"),
            },
        }
    }

    pub(super) fn request_abort(&mut self, now: Timestamp, reason: &str, outputs: &mut Outputs) {
        if matches!(self.stage, Stage::Finished { .. } | Stage::Aborted { .. }) {
            outputs.respond(false, "no experiment is running");
            return;
        }
        let running = matches!(self.stage, Stage::Running(_));
        let reason = if reason.is_empty() { "asked for by a service call" } else { reason };
        self.abort(now, reason.to_owned(), outputs);
        // At once, not at the next heartbeat.
        self.publish_command(now, self.command(), outputs);
        self.publish_state(now, outputs);
        let answer = if running {
            "aborted: the platforms go to their safe mode"
        } else {
            "aborted before it started"
        };
        outputs.respond(true, answer);
    }

    pub(super) fn shut_down(&mut self, now: Timestamp, outputs: &mut Outputs) {
        if self.parameters.role == Role::Observer {
            // The platforms continue without it.
            return;
        }
        if matches!(self.stage, Stage::Running(_)) {
            self.abort(now, "the coordinator was stopped".to_owned(), outputs);
        }
        self.publish_command(now, self.command(), outputs);
        self.publish_state(now, outputs);
    }
}
