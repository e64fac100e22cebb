//! The shell around a core: messages in, messages and log lines out.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use whorl_msgs::bounds::OutOfBounds;
use whorl_msgs::{Message, MessageType, Route, Topic};
use whorl_node::{Configurable, Event, LogLevel, LogLine, Outputs, Repeats, Response, Timestamp};
use whorl_params::Reader;

use crate::clock::{Clock, monotonic};
use crate::connection::Connection;
use crate::endpoints::Plan;
use crate::error::RosError;
use crate::log;
use crate::names::NodeName;
use crate::parameters::ParameterSet;
use crate::raw::EndpointId;
use crate::sole::{SolePublisher, Verdict};
use crate::statistics::{Arrival, SECOND_PUBLISHER, Statistics};

/// A node's single definition of its parameters.
pub(crate) type Read<P> = Box<dyn Fn(&mut Reader<'_>) -> Option<P>>;

/// The core and what does not depend on the connection.
pub(crate) struct Shell<C: Configurable> {
    pub(crate) core: C,
    pub(crate) name: NodeName,
    outputs: Outputs,
    pub(crate) clock: Clock,
    pub(crate) statistics: Statistics,
    pub(crate) parameters: ParameterSet,
    pub(crate) read: Read<C::Parameters>,
    subscriptions: Vec<(Route, MessageType)>,
    /// In the order of `subscriptions`; `None` for topics that several nodes write.
    publishers: Vec<Option<SolePublisher>>,
    contests: Repeats,
    publications: Vec<Route>,
    bytes: Vec<u8>,
    undeclared: HashSet<Route>,
    refusals: Repeats,
    pub(crate) stop: bool,
}

impl<C: Configurable> Shell<C> {
    pub(crate) fn new(
        name: NodeName,
        clock: Clock,
        core: C,
        plan: &Plan,
        parameters: ParameterSet,
        read: Read<C::Parameters>,
    ) -> Self {
        let names = |list: &[(Route, String)]| list.iter().map(|(_, name)| name.clone()).collect::<Vec<_>>();
        let statistics = Statistics::new(names(&plan.subscriptions), names(&plan.publications));
        Self {
            name,
            outputs: Outputs::default(),
            clock,
            statistics,
            parameters,
            read,
            subscriptions: plan
                .subscriptions
                .iter()
                .map(|(route, _)| (*route, route.topic.info().message_type))
                .collect(),
            publishers: plan
                .subscriptions
                .iter()
                .map(|(route, _)| {
                    let sole = route.topic.has_one_publisher();
                    sole.then(|| SolePublisher::new(route.topic.info().rate_hz))
                })
                .collect(),
            contests: Repeats::default(),
            publications: plan.publications.iter().map(|(route, _)| *route).collect(),
            bytes: Vec::new(),
            undeclared: HashSet::new(),
            refusals: Repeats::default(),
            stop: false,
            core,
        }
    }

    pub(crate) fn timer_period(&self) -> Option<Duration> {
        self.core.timer_period()
    }

    /// One step of the core, and execution of its outputs.
    pub(crate) fn step(&mut self, connection: &Connection, event: Event<'_>) -> Option<Response> {
        let now = self.clock.now();
        self.outputs.clear();
        self.core.step(now, event, &mut self.outputs);
        let mut outputs = std::mem::take(&mut self.outputs);
        for publication in outputs.messages.drain(..) {
            self.publish(connection, publication.route, Arc::unwrap_or_clone(publication.message));
        }
        for line in outputs.log.drain(..) {
            self.log(connection, now, &line);
        }
        let response = outputs.response.take();
        self.outputs = outputs;
        self.stop |= self.core.finished();
        response
    }

    /// Sends a message of the core, whose stamps are the node's time.
    pub(crate) fn publish(&mut self, connection: &Connection, route: Route, mut message: Message) {
        let Some(writer) = connection.endpoints().writer(route) else {
            self.statistics.undeclared += 1;
            if self.undeclared.insert(route) {
                self.say(connection, LogLevel::Error, format!("{route:?} is not among the publications"));
            }
            return;
        };
        self.clock.to_time_of_day(&mut message);
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

    pub(crate) fn say(&mut self, connection: &Connection, level: LogLevel, text: String) {
        let now = self.clock.now();
        self.log(connection, now, &LogLine { level, text });
    }

    fn log(&mut self, connection: &Connection, now: Timestamp, line: &LogLine) {
        let full_name = self.name.full();
        log::print(&full_name, line);
        if let Some(rosout) = &connection.endpoints().rosout {
            // `rcl` names loggers with dots and without the leading slash.
            let logger = full_name.trim_start_matches('/').replace('/', ".");
            if log::publish(rosout, &logger, self.clock.time_of_day(now), line).is_err() {
                self.statistics.publish_failures += 1;
            }
        }
    }

    pub(crate) fn report(&mut self, connection: &Connection) {
        self.statistics.parameter_sets_refused = self.parameters.refused();
        let now = self.clock.now();
        let report = self.statistics.report(&self.name.full(), now);
        self.publish(connection, Route::shared(Topic::Diagnostics), report.into());
    }

    pub(crate) fn take_messages(&mut self, connection: &Connection, generation: usize, index: usize) {
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
                Ok(mut message) => match message.check_bounds() {
                    Ok(()) if self.is_refused(connection, index, sample.writer) => {}
                    Ok(()) => {
                        self.clock.to_own(&mut message);
                        self.step(connection, Event::Message { route, message: &message });
                    }
                    Err(error) => self.out_of_bounds(connection, index, &error),
                },
                Err(error) => self.undecodable(connection, index, &error.into()),
            }
        }
    }

    /// Whether a sample is not from the publisher of its topic.
    fn is_refused(&mut self, connection: &Connection, index: usize, writer: EndpointId) -> bool {
        let Some(Some(publisher)) = self.publishers.get_mut(index) else { return false };
        let verdict = publisher.admit(monotonic(), writer.participant());
        let Some((topic, counts)) = self.statistics.subscriptions.get_mut(index) else { return false };
        match verdict {
            Verdict::Accepted => {}
            Verdict::Refused => counts.second_publisher += 1,
            Verdict::Contested(other) => {
                counts.contested += 1;
                let topic = topic.clone();
                let now = self.clock.now();
                let text = self.contests.admit(now, || {
                    let id = hexadecimal(&other);
                    format!(
                        "{topic}: {SECOND_PUBLISHER} this topic and is REFUSED (participant {id}): is another node set, \
                         or another person, in this domain?"
                    )
                });
                if let Some(text) = text {
                    self.say(connection, LogLevel::Error, text);
                }
            }
        }
        verdict == Verdict::Refused
    }

    /// Participants that left hold no topic any more.
    pub(crate) fn writers_gone(&mut self, now: Duration, writers: Vec<EndpointId>) {
        for writer in &writers {
            self.publishers.iter_mut().flatten().for_each(|publisher| publisher.gone(writer.participant()));
        }
        self.statistics.writers_gone(now, writers);
    }

    fn out_of_bounds(&mut self, connection: &Connection, index: usize, error: &OutOfBounds) {
        let now = self.clock.now();
        let Some((topic, counts)) = self.statistics.subscriptions.get_mut(index) else { return };
        counts.out_of_bounds += 1;
        let text = self.refusals.admit(now, || format!("{topic}: a message is refused: {error}"));
        if let Some(text) = text {
            self.say(connection, LogLevel::Warn, text);
        }
    }

    fn undecodable(&mut self, connection: &Connection, index: usize, error: &RosError) {
        let Some((topic, counts)) = self.statistics.subscriptions.get_mut(index) else { return };
        counts.undecodable += 1;
        // The first one is logged; /diagnostics counts the others.
        if counts.undecodable == 1 {
            let text = format!("{topic}: a message is dropped: {error}");
            self.say(connection, LogLevel::Warn, text);
        }
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
