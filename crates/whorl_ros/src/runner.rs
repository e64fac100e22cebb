//! The event loop of a node: one thread that moves messages, time and parameters.

use std::collections::HashSet;
use std::time::Duration;

use mio::{Events, Poll, Token};
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces as rcl;
use serde::{Serialize, de::DeserializeOwned};
use whorl_msgs::whorl::srv::ExperimentResponse;
use whorl_msgs::{Message, MessageType, Route, Topic, cdr};
use whorl_node::{Configurable, Event, LogLevel, LogLine, NodeCore, Outputs, Response, Timestamp};
use whorl_params::{NodeParameters, Reader};

use crate::clock::{Clock, Schedule, monotonic};
use crate::connection::{Connection, Notice};
use crate::endpoints::{ParameterService, Plan, Readable};
use crate::error::RosError;
use crate::log;
use crate::names::NodeName;
use crate::node::NodeContext;
use crate::parameters::{self, ParameterSet};
use crate::participant::Participant;
use crate::recovery::Reason;
use crate::services::{RequestId, ServiceServer, TextRequest};
use crate::statistics::{Arrival, Statistics};
use crate::wake::{Alarm, Signals};

const SIGNALS: Token = Token(0);
const ALARM: Token = Token(1);

/// How often the shell looks after peers and diagnostics; and while endpoints are being renewed.
const HOUSEKEEPING: Duration = Duration::from_millis(100);
const HOUSEKEEPING_WHILE_RENEWING: Duration = Duration::from_millis(10);
/// How often the shell looks for silent subscriptions, which needs a copy of the discovery data.
const SILENCE_CHECK: Duration = Duration::from_secs(5);
const DIAGNOSTICS: Duration = Duration::from_secs(1);

type Read<P> = Box<dyn Fn(&mut Reader<'_>) -> Option<P>>;

/// A core with everything around it.
pub(crate) struct Runner<C: Configurable> {
    node: Node<C>,
    connection: Connection,
    schedule: Option<Schedule>,
    period: Duration,
    poll: Poll,
    alarm: Alarm,
    signals: Signals,
}

/// The core and what does not depend on the connection.
struct Node<C: Configurable> {
    core: C,
    name: NodeName,
    outputs: Outputs,
    clock: Clock,
    statistics: Statistics,
    parameters: ParameterSet,
    read: Read<C::Parameters>,
    subscriptions: Vec<(Route, MessageType)>,
    publications: Vec<Route>,
    bytes: Vec<u8>,
    undeclared: HashSet<Route>,
    stop: bool,
}

impl<C: Configurable> Runner<C> {
    pub(crate) fn new(
        context: &NodeContext,
        core: C,
        parameters: ParameterSet,
        read: Read<C::Parameters>,
    ) -> Result<Self, RosError> {
        let plan = plan(context, &core)?;
        let poll = Poll::new().map_err(RosError::io("creating an event loop"))?;
        let alarm = Alarm::new(poll.registry(), ALARM)?;
        // Before the network is joined: from here on a signal is answered in order.
        let signals = Signals::new(poll.registry(), SIGNALS)?;
        let participant = Participant::new(context.network())?;
        let names = |list: &[(Route, String)]| list.iter().map(|(_, name)| name.clone()).collect::<Vec<_>>();
        let statistics = Statistics::new(names(&plan.subscriptions), names(&plan.publications));
        let node = Node {
            name: context.name().clone(),
            outputs: Outputs::default(),
            clock: Clock::default(),
            statistics,
            parameters,
            read,
            subscriptions: plan
                .subscriptions
                .iter()
                .map(|(route, _)| (*route, route.topic.info().message_type))
                .collect(),
            publications: plan.publications.iter().map(|(route, _)| *route).collect(),
            bytes: Vec::new(),
            undeclared: HashSet::new(),
            stop: false,
            core,
        };
        let connection = Connection::new(participant, plan, poll.registry())?;
        let period = node.core.timer_period().unwrap_or_default();
        let schedule = Schedule::new(monotonic(), period);
        Ok(Self { node, connection, schedule, period, poll, alarm, signals })
    }

    /// Runs until the core has finished or a signal comes.
    pub(crate) fn run(mut self) -> Result<(), RosError> {
        let network = if self.connection.is_localhost() { "this machine only" } else { "the network" };
        self.node.say(
            &self.connection,
            LogLevel::Info,
            format!("started in domain {} on {network}", self.connection.domain_id()),
        );
        let mut events = Events::with_capacity(64);
        let mut housekeeping = monotonic();
        let mut diagnostics = housekeeping + DIAGNOSTICS;
        let mut silence_check = housekeeping + SILENCE_CHECK;
        let mut silence = None;
        while !self.node.stop {
            let next_firing = self.schedule.map_or(housekeeping, |s| s.next().min(housekeeping));
            self.alarm.set(next_firing)?;
            match self.poll.poll(&mut events, None) {
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                other => other.map_err(RosError::io("waiting for events"))?,
            }
            for event in &events {
                match event.token() {
                    SIGNALS if self.signals.received() => self.node.stop = true,
                    token => self.readable(token),
                }
            }
            self.fire_timer();
            let now = monotonic();
            if now < housekeeping {
                continue;
            }
            if now >= silence_check {
                silence_check = now + SILENCE_CHECK;
                silence = self.longest_silence(now);
            }
            self.look_after_connection(now, silence)?;
            if now >= diagnostics {
                diagnostics = now + DIAGNOSTICS;
                self.node.report(&self.connection);
            }
            housekeeping =
                now + if self.connection.is_renewing() { HOUSEKEEPING_WHILE_RENEWING } else { HOUSEKEEPING };
        }
        self.node.step(&self.connection, Event::Shutdown);
        self.node.say(&self.connection, LogLevel::Info, "stopped".to_owned());
        self.connection.close()
    }

    fn fire_timer(&mut self) {
        let Some(schedule) = &mut self.schedule else { return };
        let now = monotonic();
        let due = schedule.next();
        // One at a time, so that messages which came meanwhile are not kept waiting when many
        // firings are owed.
        if schedule.fire(now) {
            if now - due > self.period {
                self.node.statistics.late_timers += 1;
            }
            self.node.step(&self.connection, Event::Timer);
        }
    }

    fn readable(&mut self, token: Token) {
        let Some((generation, what)) = self.connection.at(token) else { return };
        match what {
            Readable::Subscription(index) => self.node.take_messages(&self.connection, generation, index),
            Readable::Service(index) => self.node.serve(&self.connection, generation, index),
            Readable::Parameter(index) => self.node.serve_parameters(&self.connection, generation, index),
        }
    }

    fn look_after_connection(&mut self, now: Duration, silence: Option<Duration>) -> Result<(), RosError> {
        let notice = self.connection.look_after(now, silence, self.poll.registry())?;
        self.node.statistics.writers_gone(now, self.connection.take_lost_writers());
        self.node.statistics.missing_participants = self.connection.recovery().missing();
        self.node.statistics.renewals = self.connection.recovery().renewals();
        let missing = self.connection.recovery().missing();
        let (level, text) = match notice {
            None => return Ok(()),
            Some(Notice::Missing) => {
                (LogLevel::Warn, format!("{missing} participant(s) silent for longer than their lease"))
            }
            Some(Notice::Renewing(Reason::PeerReturned)) => {
                (LogLevel::Info, "a participant is back: renewing the endpoints".to_owned())
            }
            Some(Notice::Renewing(Reason::Silence)) => (
                LogLevel::Warn,
                "a subscription is silent though its writer is known: renewing the endpoints".to_owned(),
            ),
            Some(Notice::Renewed) => (LogLevel::Info, "endpoints renewed".to_owned()),
        };
        self.node.say(&self.connection, level, text);
        Ok(())
    }

    /// The longest silence of the subscriptions which once delivered and whose writer is known.
    fn longest_silence(&self, now: Duration) -> Option<Duration> {
        let silent: Vec<_> = self
            .node
            .statistics
            .subscriptions
            .iter()
            .filter_map(|(_, counts)| Some((counts, now.saturating_sub(counts.last?))))
            .filter(|(_, silence)| *silence > SILENCE_CHECK)
            .collect();
        if silent.is_empty() {
            return None;
        }
        let known = self.connection.known_writers();
        silent
            .into_iter()
            .filter(|(counts, _)| counts.writers().any(|writer| known.contains(writer)))
            .map(|(_, silence)| silence)
            .max()
    }
}

/// What the core needs, with the names as the command line wants them.
fn plan<C: NodeCore>(context: &NodeContext, core: &C) -> Result<Plan, RosError> {
    let node = context.name();
    let remapped = |name: String| {
        let resolved = node.resolve(&name);
        let remap = context.arguments().remaps.iter().find(|r| node.resolve(&r.from) == resolved);
        remap.map_or(resolved, |r| node.resolve(&r.to))
    };
    let named = |routes: Vec<Route>| {
        let mut list: Vec<(Route, String)> = Vec::new();
        for route in routes {
            if list.iter().any(|(r, _)| *r == route) {
                continue;
            }
            let name = route.name(context.platforms()).ok_or(RosError::Platform {
                index: route.platform.map_or(0, |p| p.0),
                count: context.platforms().len(),
            })?;
            list.push((route, remapped(name)));
        }
        Ok::<_, RosError>(list)
    };
    let mut publications = core.publications();
    publications.push(Route::shared(Topic::Diagnostics));
    Ok(Plan {
        node: node.clone(),
        subscriptions: named(core.subscriptions())?,
        publications: named(publications)?,
        services: core.services().iter().map(|s| (*s, remapped(s.name().to_owned()))).collect(),
        rosout: context.arguments().rosout,
    })
}

impl<C: Configurable> Node<C> {
    /// One step of the core, and everything that it wants done.
    fn step(&mut self, connection: &Connection, event: Event<'_>) -> Option<Response> {
        let now = self.clock.now();
        self.outputs.clear();
        self.core.step(now, event, &mut self.outputs);
        let mut outputs = std::mem::take(&mut self.outputs);
        for publication in outputs.messages.drain(..) {
            self.publish(connection, publication.route, &publication.message);
        }
        for line in outputs.log.drain(..) {
            self.log(connection, now, &line);
        }
        let response = outputs.response.take();
        self.outputs = outputs;
        self.stop |= self.core.finished();
        response
    }

    fn publish(&mut self, connection: &Connection, route: Route, message: &Message) {
        let Some(writer) = connection.endpoints().writer(route) else {
            self.statistics.undeclared += 1;
            if self.undeclared.insert(route) {
                self.say(connection, LogLevel::Error, format!("{route:?} is not among the publications"));
            }
            return;
        };
        match message
            .encode_into(&mut self.bytes)
            .map_err(RosError::from)
            .and_then(|()| writer.publish(&self.bytes))
        {
            Ok(()) => {
                let index = self.publications.iter().position(|r| *r == route);
                if let Some((_, sent)) = index.and_then(|i| self.statistics.publications.get_mut(i)) {
                    *sent += 1;
                }
            }
            Err(error) => {
                self.statistics.publish_failures += 1;
                // Not to /rosout, which goes the same way.
                tracing::debug!(target: "whorl", "{}: {error}", self.name.full());
            }
        }
    }

    fn say(&mut self, connection: &Connection, level: LogLevel, text: String) {
        let now = self.clock.now();
        self.log(connection, now, &LogLine { level, text });
    }

    fn log(&mut self, connection: &Connection, now: Timestamp, line: &LogLine) {
        let full_name = self.name.full();
        log::print(&full_name, line);
        if let Some(rosout) = &connection.endpoints().rosout {
            // `rcl` names loggers with dots and without the leading slash.
            let logger = full_name.trim_start_matches('/').replace('/', ".");
            if log::publish(rosout, &logger, now, line).is_err() {
                self.statistics.publish_failures += 1;
            }
        }
    }

    fn report(&mut self, connection: &Connection) {
        self.statistics.parameter_sets_refused = self.parameters.refused();
        let now = self.clock.now();
        let report = self.statistics.report(&self.name.full(), now);
        self.publish(connection, Route::shared(Topic::Diagnostics), &report.into());
    }

    fn take_messages(&mut self, connection: &Connection, generation: usize, index: usize) {
        let Some(&(route, message_type)) = self.subscriptions.get(index) else { return };
        let Some(endpoints) = connection.generations().nth(generation) else { return };
        let Some(reader) = endpoints.subscriptions.get(index) else { return };
        reader.drain_notifications();
        while !self.stop {
            let sample = match reader.take() {
                Ok(Some(sample)) => sample,
                Ok(None) => return,
                Err(error) => {
                    self.undecodable(connection, index, &error);
                    continue;
                }
            };
            let Some((_, counts)) = self.statistics.subscriptions.get_mut(index) else { return };
            if counts.arrival(monotonic(), sample.writer, sample.sequence_number) == Arrival::Old {
                continue;
            }
            match Message::decode(message_type, &sample.bytes) {
                Ok(message) => {
                    self.step(connection, Event::Message { route, message: &message });
                }
                Err(error) => self.undecodable(connection, index, &error.into()),
            }
        }
    }

    fn undecodable(&mut self, connection: &Connection, index: usize, error: &RosError) {
        let Some((topic, counts)) = self.statistics.subscriptions.get_mut(index) else { return };
        counts.undecodable += 1;
        // The first one is told; /diagnostics counts the others.
        if counts.undecodable == 1 {
            let text = format!("{topic}: a message is dropped: {error}");
            self.say(connection, LogLevel::Warn, text);
        }
    }

    fn serve(&mut self, connection: &Connection, generation: usize, index: usize) {
        let Some(endpoints) = connection.generations().nth(generation) else { return };
        let Some((service, server)) = endpoints.services.get(index) else { return };
        while let Some((id, bytes)) = self.take_request(connection, server) {
            let answer = match cdr::decode::<TextRequest>("service request", &bytes) {
                Ok(request) => {
                    let event = Event::Request { service: *service, argument: &request.argument };
                    match self.step(connection, event) {
                        Some(Response { success, message }) => ExperimentResponse { success, message },
                        None => {
                            ExperimentResponse { success: false, message: "the node did not answer".into() }
                        }
                    }
                }
                Err(error) => ExperimentResponse { success: false, message: error.to_string() },
            };
            self.answer(connection, server, id, &answer);
        }
    }

    fn take_request(
        &mut self,
        connection: &Connection,
        server: &ServiceServer,
    ) -> Option<(RequestId, Vec<u8>)> {
        loop {
            match server.take() {
                Ok(request) => return request,
                Err(error) => self.say(connection, LogLevel::Warn, format!("a request is dropped: {error}")),
            }
        }
    }

    fn answer<T: Serialize>(
        &mut self,
        connection: &Connection,
        server: &ServiceServer,
        id: RequestId,
        answer: &T,
    ) {
        if let Err(error) = server.respond(id, answer) {
            self.say(connection, LogLevel::Warn, format!("a request could not be answered: {error}"));
        }
    }

    fn serve_parameters(&mut self, connection: &Connection, generation: usize, index: usize) {
        let Some(endpoints) = connection.generations().nth(generation) else { return };
        let Some((service, server)) = endpoints.parameters.get(index) else { return };
        while let Some((id, bytes)) = self.take_request(connection, server) {
            if let Err(error) = self.serve_parameter(connection, *service, server, id, &bytes) {
                self.say(connection, LogLevel::Warn, format!("{}: {error}", service.names().0));
            }
        }
    }

    fn serve_parameter(
        &mut self,
        connection: &Connection,
        service: ParameterService,
        server: &ServiceServer,
        id: RequestId,
        bytes: &[u8],
    ) -> Result<(), RosError> {
        fn request<T: DeserializeOwned>(service: ParameterService, bytes: &[u8]) -> Result<T, RosError> {
            Ok(cdr::decode(service.names().1, bytes)?)
        }
        let result = |outcome: Result<(), String>| match outcome {
            Ok(()) => raw::SetParametersResult { successful: true, reason: String::new() },
            Err(reason) => raw::SetParametersResult { successful: false, reason },
        };
        match service {
            ParameterService::Get => {
                let rcl::GetParametersRequest { names } = request(service, bytes)?;
                server.respond(id, &rcl::GetParametersResponse { values: self.parameters.get(&names) })
            }
            ParameterService::GetTypes => {
                let rcl::GetParameterTypesRequest { names } = request(service, bytes)?;
                server.respond(id, &rcl::GetParameterTypesResponse { values: self.parameters.types(&names) })
            }
            ParameterService::List => {
                let rcl::ListParametersRequest { prefixes, depth } = request(service, bytes)?;
                let result = self.parameters.list(&prefixes, depth);
                server.respond(id, &rcl::ListParametersResponse { result })
            }
            ParameterService::Describe => {
                let rcl::DescribeParametersRequest { names } = request(service, bytes)?;
                let values = self.parameters.descriptions(&names);
                server.respond(id, &rcl::DescribeParametersResponse { values })
            }
            ParameterService::Set => {
                let rcl::SetParametersRequest { parameter } = request(service, bytes)?;
                let results = parameter
                    .iter()
                    .map(|change| result(self.set(connection, std::slice::from_ref(change))))
                    .collect();
                server.respond(id, &rcl::SetParametersResponse { results })
            }
            ParameterService::SetAtomically => {
                let rcl::SetParametersRequest { parameter } = request(service, bytes)?;
                let result = result(self.set(connection, &parameter));
                server.respond(id, &rcl::SetParametersAtomicallyResponse { result })
            }
        }
    }

    fn set(&mut self, connection: &Connection, changes: &[raw::Parameter]) -> Result<(), String> {
        let Self { core, read, parameters, .. } = self;
        let read = &*read;
        let mut apply = |all: &NodeParameters| {
            let (values, descriptors) = parameters::read(all, read).map_err(|e| e.to_string())?;
            core.reconfigure(&values)?;
            Ok(descriptors)
        };
        let names = || changes.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        match parameters.set(changes, &mut apply) {
            Ok(changed) => {
                if !changed.is_empty() {
                    self.say(connection, LogLevel::Info, format!("parameter set: {}", names()));
                    self.publish_parameter_event(connection, changed);
                }
                Ok(())
            }
            Err(reason) => {
                self.say(connection, LogLevel::Warn, format!("parameter set refused: {reason}"));
                Err(reason)
            }
        }
    }

    fn publish_parameter_event(&mut self, connection: &Connection, changed: Vec<raw::Parameter>) {
        let event = parameters::ParameterEvent {
            stamp: self.clock.now().into(),
            node: self.name.full(),
            new_parameters: Vec::new(),
            changed_parameters: changed,
            deleted_parameters: Vec::new(),
        };
        let writer = &connection.endpoints().parameter_events;
        let sent = cdr::encode("rcl_interfaces/msg/ParameterEvent", &event).map_err(RosError::from);
        if sent.and_then(|bytes| writer.publish(&bytes)).is_err() {
            self.statistics.publish_failures += 1;
        }
    }
}
