//! The coordinator's state machine.

mod earlier;
mod publishing;
mod requests;

use std::time::Duration;

use whorl_control::formation::LimitsError;
use whorl_msgs::topics::{Message, PlatformId, Route, Service, Topic};
use whorl_msgs::whorl::FormationCommand;
use whorl_node::{Configurable, Event, LogLevel, NodeCore, Outputs, Timestamp};

use crate::link::PlatformLink;
use crate::parameters::{AtEnd, Parameters, Role};
use crate::progress::Earlier;
use crate::report;
use crate::run::{Progress, Run, Sight};
use crate::stage::Stage;

/// The timer; everything is published at whole multiples of it.
const PERIOD: Duration = Duration::from_millis(10);
const REFERENCE_TICKS: u64 = 2;
const COMMAND_TICKS: u64 = 5;
const STATE_TICKS: u64 = 10;
const DIAGNOSTICS_TICKS: u64 = 100;
/// References are stamped on a grid; a timer that is later than this shifts the grid \[s\].
const LATEST_S: f64 = 0.1;
/// The final state is published for this long before the node exits \[s\].
const END_FOR_S: f64 = 1.0;

/// The coordinator.
#[derive(Debug)]
pub struct CoordinatorCore {
    parameters: Parameters,
    links: Vec<PlatformLink>,
    stage: Stage,
    ticks: u64,
    /// Instant of the latest tick, on the grid.
    tick_at: Option<Timestamp>,
    sequences: Sequences,
    finished: bool,
    problems: Vec<String>,
    /// Whether traffic is secured.
    secured: bool,
    /// Of the coordinator before, whose experiment this one goes on with.
    earlier: Option<Earlier>,
}

/// Sequence counters of the messages sent.
#[derive(Debug, Default)]
struct Sequences {
    reference: u64,
    command: u64,
    excitation: u64,
    state: u64,
    clock: u64,
}

impl CoordinatorCore {
    /// A coordinator that waits for its platforms.
    ///
    /// # Errors
    /// Invalid limits of a platform.
    pub fn new(parameters: Parameters) -> Result<Self, LimitsError> {
        parameters.limits.iter().try_for_each(|limits| limits.check())?;
        Ok(Self {
            links: parameters.platforms.iter().map(|name| PlatformLink::new(name)).collect(),
            parameters,
            stage: Stage::Waiting { since: Timestamp::default(), well_since: None },
            ticks: 0,
            tick_at: None,
            sequences: Sequences::default(),
            finished: false,
            problems: Vec::new(),
            secured: false,
            earlier: None,
        })
    }

    /// The same where keys are exchanged before messages are: it waits for `waiting.healthy_for_secured_s`.
    #[must_use]
    pub fn secured(self, secured: bool) -> Self {
        Self { secured, ..self }
    }

    fn tick(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let first = self.tick_at.is_none();
        let at = self.tick_at.map_or(now, |last| last + PERIOD);
        // The shell was suspended, or the clock was set: the grid shifts, the motion does not jump.
        let at = if now.seconds_since(at).abs() > LATEST_S { now } else { at };
        self.tick_at = Some(at);
        if first && let Stage::Waiting { since, .. } = &mut self.stage {
            *since = at;
        }
        if first {
            self.look_at_earlier(now, outputs);
        }
        if self.ticks.is_multiple_of(REFERENCE_TICKS) {
            self.control(at, now, outputs);
        }
        if self.ticks.is_multiple_of(COMMAND_TICKS) {
            self.publish_command(now, self.command(), outputs);
        }
        if self.ticks.is_multiple_of(STATE_TICKS) {
            self.publish_state(now, outputs);
        }
        if self.ticks.is_multiple_of(DIAGNOSTICS_TICKS) {
            let array = report::diagnostics(now, &self.parameters, &self.links, &self.stage, &self.problems);
            outputs.publish(Route::shared(Topic::Diagnostics), array);
        }
        self.ask_for_time(now, outputs);
        self.ticks += 1;
    }

    /// One period of the references, for the instant `at`.
    fn control(&mut self, at: Timestamp, now: Timestamp, outputs: &mut Outputs) {
        let problems = self.current_problems(now);
        if problems != self.problems {
            self.log_problems(&problems, outputs);
            self.problems = problems;
        }
        self.give_up_earlier(now, outputs);
        let sights = self.sights(at);
        match &mut self.stage {
            Stage::Waiting { since, well_since } => {
                let waiting = &self.parameters.waiting;
                if !self.problems.is_empty() {
                    *well_since = None;
                    if now.seconds_since(*since) > waiting.timeout_s {
                        let reason =
                            format!("not ready within {} s: {}", waiting.timeout_s, self.problems.join("; "));
                        self.abort(now, reason, outputs);
                    }
                } else {
                    let well_since = *well_since.get_or_insert(now);
                    if now.seconds_since(well_since) >= waiting.healthy_for_s(self.secured) {
                        outputs.log(LogLevel::Info, "all platforms are well: ready");
                        self.stage = Stage::Ready;
                    }
                }
            }
            Stage::Ready if !self.problems.is_empty() => {
                self.stage = Stage::Waiting { since: now, well_since: None };
            }
            // Platforms that run themselves decide when; an observer follows their authority.
            Stage::Ready if self.parameters.role == Role::Observer => {}
            Stage::Ready if self.parameters.experiment.auto_start || self.earlier.is_some() => {
                if let Err(reason) = self.start(at, outputs) {
                    outputs.log(LogLevel::Warn, format!("cannot start: {reason}"));
                }
            }
            Stage::Ready => {}
            Stage::Running(run) => {
                let was_paused = run.paused;
                let progress = run.tick(&self.parameters, &sights, at, outputs);
                if run.paused != was_paused {
                    let text = if run.paused {
                        format!("the experiment waits for {}", self.problems.join("; "))
                    } else {
                        "the experiment goes on".to_owned()
                    };
                    outputs.log(if run.paused { LogLevel::Warn } else { LogLevel::Info }, text);
                }
                match progress {
                    Progress::Running => {}
                    Progress::Finished => self.finish(now, outputs),
                    Progress::Abort(reason) => {
                        let why = [vec![reason], self.problems.clone()].concat().join("; ");
                        self.abort(now, why, outputs);
                    }
                }
                self.publish_references(at, outputs);
                self.publish_excitations(at, outputs);
            }
            Stage::Finished { run, at: ended } => {
                run.tick_finished();
                self.finished =
                    self.parameters.experiment.exit_when_finished && now.seconds_since(*ended) >= END_FOR_S;
                if self.parameters.experiment.at_end == AtEnd::Hold {
                    self.publish_references(at, outputs);
                }
            }
            Stage::Aborted { run, at: ended, .. } => {
                let for_s = if run.is_some() { self.parameters.faults.abort_for_s } else { END_FOR_S };
                self.finished =
                    self.parameters.experiment.exit_when_finished && now.seconds_since(*ended) >= for_s;
            }
        }
    }

    fn start(&mut self, at: Timestamp, outputs: &mut Outputs) -> Result<(), String> {
        let sights = self.sights(at);
        let name = &self.parameters.experiment.name;
        let run = match &self.earlier {
            Some(Earlier::GoesOn(progress, ended)) => {
                let away_s = at.seconds_since(*ended).max(0.0);
                outputs.log(
                    LogLevel::Warn,
                    format!("experiment {name} goes on after {away_s:.1} s without a coordinator"),
                );
                Run::go_on(&self.parameters, progress, away_s, &sights, at, outputs)?
            }
            _ => {
                outputs.log(LogLevel::Info, format!("experiment {name} starts"));
                Run::start(&self.parameters, &sights, at, outputs)?
            }
        };
        self.earlier = None;
        self.stage = Stage::Running(Box::new(run));
        self.finished = false;
        // Before the first command gives authority.
        self.publish_references(at, outputs);
        Ok(())
    }

    fn finish(&mut self, now: Timestamp, outputs: &mut Outputs) {
        let before = std::mem::replace(&mut self.stage, Stage::Ready);
        if let Stage::Running(run) = before {
            outputs
                .log(LogLevel::Info, format!("experiment {} is finished", self.parameters.experiment.name));
            self.stage = Stage::Finished { run, at: now };
        }
    }

    fn abort(&mut self, now: Timestamp, reason: String, outputs: &mut Outputs) {
        outputs.log(LogLevel::Error, format!("aborted: {reason}"));
        self.earlier = None;
        let before = std::mem::replace(&mut self.stage, Stage::Ready);
        let run = if let Stage::Running(run) = before { Some(run) } else { None };
        self.stage = Stage::Aborted { run, at: now, reason };
    }

    fn sights(&self, at: Timestamp) -> Vec<Sight> {
        let settings = &self.parameters.link;
        let sight = |link: &PlatformLink| Sight {
            motion: link.motion(at, settings),
            age_s: link.age_s(at),
            fresh: link.fresh(at, settings),
            mismatch: link.mismatch().is_some(),
            following: link.following(at, settings),
            deaf: link.deaf(at, settings),
            excited: link.excited(at, settings),
            reference: link.reference(at, settings),
        };
        self.links.iter().map(sight).collect()
    }

    /// Current problems in words; at most one sentence per platform.
    fn current_problems(&self, now: Timestamp) -> Vec<String> {
        let settings = &self.parameters.link;
        let running = matches!(self.stage, Stage::Running(_));
        let problem = |link: &PlatformLink| {
            link.estimate_problem(now, settings).or_else(|| {
                if running {
                    link.following_problem(now, settings)
                } else {
                    link.control_problem(now, settings)
                }
            })
        };
        let of_this = |platform: usize| {
            if running { self.parameters.commands(platform) } else { self.parameters.hears(platform) }
        };
        let heard = self.links.iter().enumerate().filter(|(platform, _)| of_this(*platform));
        let holds = running && self.parameters.experiment.holds_on_mismatch.is_some();
        let mismatch = |link: &PlatformLink| link.mismatch().filter(|_| holds).map(str::to_owned);
        let of_platforms = heard.filter_map(|(_, link)| problem(link).or_else(|| mismatch(link)));
        let held = match &self.stage {
            Stage::Running(run) => run.held.clone(),
            _ => None,
        };
        held.into_iter().chain(of_platforms).collect()
    }

    /// Logs new problems of platforms, without repeating them when only an age has changed.
    fn log_problems(&self, problems: &[String], outputs: &mut Outputs) {
        if !matches!(self.stage, Stage::Waiting { .. } | Stage::Ready) {
            return;
        }
        let kind = |text: &str| text.chars().filter(|c| !c.is_ascii_digit()).collect::<String>();
        for problem in problems {
            if !self.problems.iter().any(|known| kind(known) == kind(problem)) {
                outputs.log(LogLevel::Info, format!("waiting for {problem}"));
            }
        }
    }

    fn command(&self) -> u8 {
        match &self.stage {
            Stage::Waiting { .. } | Stage::Ready | Stage::Aborted { run: None, .. } => {
                FormationCommand::COMMAND_STANDBY
            }
            Stage::Running(_) => FormationCommand::COMMAND_TRACK,
            Stage::Finished { .. } => match self.parameters.experiment.at_end {
                AtEnd::Standby => FormationCommand::COMMAND_STANDBY,
                AtEnd::Hold => FormationCommand::COMMAND_HOLD,
            },
            Stage::Aborted { run: Some(_), .. } => FormationCommand::COMMAND_ABORT,
        }
    }

    /// A command of another coordinator, when the law runs on the platforms: a tracking platform starts the others, and
    /// an abort of all platforms is obeyed.
    fn hear_command(&mut self, now: Timestamp, command: &FormationCommand, outputs: &mut Outputs) {
        let waits = matches!(self.stage, Stage::Waiting { .. } | Stage::Ready);
        match command.command {
            FormationCommand::COMMAND_TRACK if waits && self.current_problems(now).is_empty() => {
                let at = self.tick_at.unwrap_or(now);
                if let Err(reason) = self.start(at, outputs) {
                    outputs.log(LogLevel::Warn, format!("cannot start: {reason}"));
                }
            }
            FormationCommand::COMMAND_ABORT
                if command.header.frame_id.is_empty() && matches!(self.stage, Stage::Running(_)) =>
            {
                self.abort(now, "the formation was told to abort".to_owned(), outputs);
            }
            _ => {}
        }
    }

    fn take(&mut self, now: Timestamp, route: Route, message: &Message, outputs: &mut Outputs) {
        if let Message::FormationCommand(command) = message {
            if self.parameters.role != Role::Formation {
                self.hear_command(now, command, outputs);
            }
            return;
        }
        let Some(link) = route.platform.and_then(|id| self.links.get_mut(usize::from(id.0))) else { return };
        match (route.topic, message) {
            (Topic::AttitudeEstimate, Message::AttitudeEstimate(estimate)) => {
                link.take_estimate(now, estimate, &self.parameters.link);
            }
            (Topic::ControlStatus, Message::ControlStatus(status)) => {
                link.take_status(now, status, &self.parameters.link);
            }
            (Topic::ModelFit, Message::ModelFit(fit)) => link.take_fit(fit),
            (Topic::AttitudeReference, Message::AttitudeReference(reference)) => {
                link.take_reference(now, reference, &self.parameters.link);
            }
            (Topic::Clock, Message::ClockReply(reply)) if reply.header.frame_id == self.parameters.name() => {
                let changes = link.take_time(now, reply);
                if changes {
                    outputs.log(LogLevel::Info, report::clock_in_words(link));
                }
            }
            _ => {}
        }
    }
}

impl NodeCore for CoordinatorCore {
    fn subscriptions(&self) -> Vec<Route> {
        let heard = |route: &Route| {
            route.platform.is_none_or(|PlatformId(id)| self.parameters.hears(usize::from(id)))
        };
        let mut routes = self.routes(&[Topic::AttitudeEstimate, Topic::ControlStatus, Topic::Clock]);
        if self.parameters.role != Role::Formation {
            routes.extend(self.routes(&[Topic::AttitudeReference]).into_iter().filter(|route| {
                route.platform.is_some_and(|PlatformId(id)| !self.parameters.commands(usize::from(id)))
            }));
            routes.push(Route::shared(Topic::FormationCommand));
        }
        if self.parameters.experiment.holds_on_mismatch.is_some() {
            routes.extend(self.routes(&[Topic::ModelFit]));
        }
        routes.retain(heard);
        routes
    }

    fn publications(&self) -> Vec<Route> {
        let mut routes = self.routes(&[Topic::AttitudeReference, Topic::Excitation]);
        routes.retain(|route| {
            route.platform.is_some_and(|PlatformId(id)| self.parameters.commands(usize::from(id)))
        });
        routes
            .extend([Topic::FormationCommand, Topic::FormationClock, Topic::Diagnostics].map(Route::shared));
        if !matches!(self.parameters.role, Role::Platform(_)) {
            routes.push(Route::shared(Topic::FormationState));
        }
        routes
    }

    fn timer_period(&self) -> Option<Duration> {
        Some(PERIOD)
    }

    fn services(&self) -> &'static [Service] {
        match self.parameters.role {
            Role::Platform(_) => &[],
            Role::Formation | Role::Observer => &Service::ALL,
        }
    }

    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs) {
        match event {
            Event::Message { route, message } => self.take(now, route, message, outputs),
            Event::Timer => self.tick(now, outputs),
            Event::Request { service: Service::StartExperiment, argument } => {
                self.request_start(now, argument, outputs);
            }
            Event::Request { service: Service::AbortExperiment, argument } => {
                self.request_abort(now, argument, outputs);
            }
            Event::Request { service: Service::HoldExperiment, argument } => {
                self.request_hold(argument, outputs);
            }
            Event::Shutdown => self.shut_down(now, outputs),
            // Platforms come to rest when nobody commands them.
            Event::Interruption | Event::Woken => {}
        }
    }

    fn finished(&self) -> bool {
        self.finished
    }

    fn failure(&self) -> Option<String> {
        let reason = self.abort_reason().filter(|_| self.finished)?;
        Some(format!("the experiment was aborted: {reason}"))
    }
}

impl CoordinatorCore {
    fn routes(&self, topics: &[Topic]) -> Vec<Route> {
        let platforms = (0u16..).zip(&self.links).map(|(id, _)| PlatformId(id));
        platforms.flat_map(|id| topics.iter().map(move |topic| Route::platform(id, *topic))).collect()
    }

    /// The phase, `FormationState::PHASE_*`.
    #[must_use]
    pub fn phase(&self) -> u8 {
        report::phase(&self.parameters, &self.stage)
    }

    /// Reason for the abort, if any.
    #[must_use]
    pub fn abort_reason(&self) -> Option<&str> {
        match &self.stage {
            Stage::Aborted { reason, .. } => Some(reason),
            _ => None,
        }
    }
}

impl Configurable for CoordinatorCore {
    type Parameters = Parameters;

    fn reconfigure(&mut self, parameters: &Parameters) -> Result<(), String> {
        parameters.limits.iter().try_for_each(|limits| limits.check()).map_err(|e| e.to_string())?;
        if parameters.platforms != self.parameters.platforms || parameters.role != self.parameters.role {
            return Err("the platforms cannot be changed while the coordinator runs".to_owned());
        }
        let same_experiment = parameters.steps == self.parameters.steps
            && parameters.law == self.parameters.law
            && parameters.experiment == self.parameters.experiment;
        if let Stage::Running(run) = &mut self.stage {
            if !same_experiment {
                return Err("steps, law and experiment cannot be changed while it runs".to_owned());
            }
            run.apply_limits(parameters);
        }
        self.parameters = parameters.clone();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
