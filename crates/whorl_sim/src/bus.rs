//! The in-process stand-in for DDS: an event queue ordered by time, then by order of sending.

use std::sync::Arc;
use std::time::Duration;

use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_node::{Event, LogLine, NodeCore, Outputs, Timestamp};

use crate::agenda::Agenda;
use crate::link::{Host, Link, LinkParameters};

/// Observes all events, in order of time.
pub trait Observer {
    /// Error of the observer.
    type Error;

    /// A node published a message.
    ///
    /// # Errors
    /// Ends the simulation.
    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), Self::Error>;

    /// A node wrote a log line.
    fn logged(&mut self, now: Timestamp, node: &str, line: &LogLine);

    /// A node is about to be stepped with this event, by its own clock; for journals.
    fn stepping(&mut self, _now: Timestamp, _node: &str, _event: &Event<'_>) {}
}

struct Node {
    name: String,
    host: Host,
    core: Box<dyn NodeCore>,
    timer_period: Option<Duration>,
    /// Offset of its clock from simulated time \[ns\].
    ahead_ns: i64,
}

impl Node {
    fn shown(&self, now: Timestamp) -> Timestamp {
        Timestamp(now.0.saturating_add(self.ahead_ns))
    }
}

enum Delivery {
    Timer,
    Message { route: Route, message: Arc<Message> },
}

/// A set of node cores and the queue of their events.
pub struct Bus {
    nodes: Vec<Node>,
    /// Subscribers of each route, by [`Bus::route_index`].
    subscribers: Vec<Vec<usize>>,
    platforms: usize,
    agenda: Agenda<(usize, Delivery)>,
    now: Timestamp,
    local_delay: Duration,
    link: Link,
    outputs: Outputs,
    stepped: Vec<usize>,
    link_messages: u64,
}

impl Bus {
    /// An empty bus for `platforms` platforms. `seed` drives link loss and jitter only.
    #[must_use]
    pub fn new(
        start: Timestamp,
        platforms: usize,
        local_delay: Duration,
        link: LinkParameters,
        seed: u64,
    ) -> Self {
        Self {
            nodes: Vec::new(),
            subscribers: vec![Vec::new(); Topic::ALL.len() * (platforms + 1)],
            platforms,
            agenda: Agenda::default(),
            now: start,
            local_delay,
            link: Link::new(link, start, seed),
            outputs: Outputs::default(),
            stepped: Vec::new(),
            link_messages: 0,
        }
    }

    /// Adds a node whose timer first fires `phase` after the start.
    pub fn add(&mut self, name: impl Into<String>, host: Host, core: Box<dyn NodeCore>, phase: Duration) {
        let index = self.nodes.len();
        for route in core.subscriptions() {
            if let Some(slot) = self.route_index(route) {
                self.subscribers[slot].push(index);
            }
        }
        let timer_period = core.timer_period();
        if timer_period.is_some() {
            self.agenda.enter(self.now + phase, (index, Delivery::Timer));
        }
        self.nodes.push(Node { name: name.into(), host, core, timer_period, ahead_ns: 0 });
    }

    /// Sets the clock offset of a computer against simulated time \[s\], for nodes that were added before.
    pub fn set_clock(&mut self, host: Host, ahead_s: f64) {
        for node in self.nodes.iter_mut().filter(|node| node.host == host) {
            node.ahead_ns = (ahead_s * 1e9).round() as i64;
        }
    }

    /// Simulated time.
    #[must_use]
    pub fn now(&self) -> Timestamp {
        self.now
    }

    /// Messages sent from one computer to another so far, each receiver counted, lost ones included.
    #[must_use]
    pub fn link_messages(&self) -> u64 {
        self.link_messages
    }

    /// Whether the named node has finished its work.
    #[must_use]
    pub fn finished(&self, name: &str) -> bool {
        self.nodes.iter().any(|node| node.name == name && node.core.finished())
    }

    /// Delivers all events up to and including `until`.
    ///
    /// # Errors
    /// The observer's.
    pub fn run_until<O: Observer>(&mut self, until: Timestamp, observer: &mut O) -> Result<(), O::Error> {
        while let Some((at, (index, delivery))) = self.agenda.next_until(until) {
            self.now = at;
            match delivery {
                Delivery::Timer => {
                    if let Some(period) = self.nodes[index].timer_period {
                        self.agenda.enter(at + period, (index, Delivery::Timer));
                    }
                    self.step(index, Event::Timer, observer)?;
                }
                Delivery::Message { route, message } => {
                    self.step(index, Event::Message { route, message: &message }, observer)?;
                }
            }
        }
        self.now = self.now.max(until);
        Ok(())
    }

    /// Tells every node that the run ends.
    ///
    /// # Errors
    /// The observer's.
    pub fn shut_down<O: Observer>(&mut self, observer: &mut O) -> Result<(), O::Error> {
        (0..self.nodes.len()).try_for_each(|node| self.step(node, Event::Shutdown, observer))
    }

    fn step<O: Observer>(
        &mut self,
        index: usize,
        event: Event<'_>,
        observer: &mut O,
    ) -> Result<(), O::Error> {
        let mut outputs = std::mem::take(&mut self.outputs);
        outputs.clear();
        let node = &mut self.nodes[index];
        let shown = node.shown(self.now);
        observer.stepping(shown, &node.name, &event);
        node.core.step(shown, event, &mut outputs);
        let host = node.host;
        for line in &outputs.log {
            observer.logged(self.now, &self.nodes[index].name, line);
        }
        for publication in outputs.messages.drain(..) {
            observer.published(self.now, publication.route, &publication.message)?;
            self.send(host, publication.route, publication.message);
        }
        self.outputs = outputs;
        Ok(())
    }

    fn send(&mut self, from: Host, route: Route, message: Arc<Message>) {
        let Some(slot) = self.route_index(route) else { return };
        if self.subscribers[slot].is_empty() {
            return;
        }
        let mut stepped = std::mem::take(&mut self.stepped);
        stepped.clone_from(&self.subscribers[slot]);
        let (last, mut message) = (stepped.len() - 1, Some(message));
        for (k, &node) in stepped.iter().enumerate() {
            let delay = if self.nodes[node].host == from {
                Some(self.local_delay)
            } else {
                self.link_messages += 1;
                self.link.delay(self.now, [from, self.nodes[node].host])
            };
            // The last receiver gets this one.
            let own = if k == last { message.take() } else { message.clone() };
            if let Some((delay, message)) = delay.zip(own) {
                self.agenda.enter(self.now + delay, (node, Delivery::Message { route, message }));
            }
        }
        self.stepped = stepped;
    }

    /// `None` for a platform that does not exist.
    fn route_index(&self, route: Route) -> Option<usize> {
        let column = match route.platform {
            None => 0,
            Some(PlatformId(id)) if usize::from(id) < self.platforms => usize::from(id) + 1,
            Some(_) => return None,
        };
        Some(column * Topic::ALL.len() + route.topic as usize)
    }
}
