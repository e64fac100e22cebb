//! An observer on the network that keeps every message of the table of topics.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_node::Timestamp;
use whorl_ros::environment::Network;
use whorl_ros::{EndpointQos, Handshakes, Participant, RawReader, monotonic};

use super::machine::prefer;
use super::typed::Typed;

/// Everything seen so far: messages with their time of arrival by the wall clock.
#[derive(Debug, Default)]
pub struct Log {
    seen: BTreeMap<Route, Vec<(Timestamp, Message)>>,
}

/// A topic of one platform, by its place in the list, or a shared one.
pub fn route(platform: u16, topic: Topic) -> Route {
    if topic.info().per_platform {
        Route::platform(PlatformId(platform), topic)
    } else {
        Route::shared(topic)
    }
}

impl Log {
    /// Messages of one topic with their time of arrival, oldest first.
    pub fn of<T: Typed>(&self, route: Route) -> impl DoubleEndedIterator<Item = (Timestamp, &T)> {
        let seen = self.seen.get(&route).map_or(&[][..], Vec::as_slice);
        seen.iter().filter_map(|(at, message)| Some((*at, T::of(message)?)))
    }

    /// Those that arrived after `since`.
    pub fn after<T: Typed>(&self, route: Route, since: Timestamp) -> impl Iterator<Item = (Timestamp, &T)> {
        // Newest first and back again, because the wanted messages are near the end.
        let recent: Vec<_> = self.of::<T>(route).rev().take_while(|(at, _)| *at > since).collect();
        recent.into_iter().rev()
    }

    /// The latest one.
    pub fn latest<T: Typed>(&self, route: Route) -> Option<(Timestamp, &T)> {
        self.of(route).next_back()
    }
}

/// Listens in a thread of its own until dropped.
pub struct Watch {
    log: Arc<Mutex<Log>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Listens on the loopback interface of a domain.
    pub fn new(domain: u16, platforms: &[&str]) -> Self {
        Self::on(Network::localhost(domain), platforms)
    }

    /// Listens on a network, in the network namespace of the calling thread.
    pub fn on(network: Network, platforms: &[&str]) -> Self {
        prefer(None);
        let log = Arc::new(Mutex::new(Log::default()));
        let end = Arc::new(AtomicBool::new(false));
        let count = u16::try_from(platforms.len()).unwrap();
        let mut topics = Vec::new();
        for &topic in Topic::ALL {
            let info = topic.info();
            for platform in 0..if info.per_platform { count } else { 1 } {
                let route = route(platform, topic);
                // A deep queue: an observer on a busy machine must not lose messages.
                let qos = EndpointQos { depth: 1000, ..EndpointQos::from(info.qos) };
                topics.push((route, route.name(platforms).unwrap(), info.message_type.name(), qos));
            }
        }
        let all = move |participant: &Participant| {
            let reader = |(route, name, message_type, qos): &(Route, String, &str, EndpointQos)| {
                Ok((*route, participant.reader(name, message_type, *qos)?))
            };
            topics.iter().map(reader).collect::<Result<Vec<_>, _>>()
        };
        let joined = Participant::with(&network, &all).unwrap();
        let (kept, stop) = (log.clone(), end.clone());
        let mut handshakes = network.enclave.is_some().then(|| Handshakes::new(monotonic()));
        let thread = std::thread::spawn(move || {
            let (mut participant, mut readers) = joined;
            while !stop.load(Ordering::Relaxed) {
                take_all(&readers, &kept);
                // As a node does that lacks something: an observer lacks whoever does not exchange keys with it.
                if handshakes.as_mut().is_some_and(|handshakes| do_not_end(handshakes, &participant)) {
                    println!("the observer does not hear everybody: it rejoins the network");
                    handshakes = handshakes.as_ref().map(Handshakes::renewed);
                    (participant, readers) = Participant::with(&network, &all).unwrap();
                }
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        Self { log, end, thread: Some(thread) }
    }

    /// What was seen so far.
    pub fn log(&self) -> MutexGuard<'_, Log> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until something is found in the log.
    pub fn wait<T>(&self, what: &str, timeout: Duration, find: impl Fn(&Log) -> Option<T>) -> T {
        let begin = Instant::now();
        loop {
            let found = find(&self.log());
            if let Some(value) = found {
                return value;
            }
            assert!(begin.elapsed() < timeout, "waited {timeout:?} for {what}\n{}", self.summary());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits for a message that arrives from now on.
    pub fn wait_next<T: Typed>(
        &self,
        what: &str,
        route: Route,
        timeout: Duration,
        wanted: impl Fn(&T) -> bool,
    ) -> Timestamp {
        let since = whorl_ros::wall_clock();
        self.wait(what, timeout, |log| {
            log.after::<T>(route, since).find(|(_, m)| wanted(m)).map(|(at, _)| at)
        })
    }

    /// Records messages for some time; returns its start.
    pub fn during(&self, time: Duration) -> Timestamp {
        let since = whorl_ros::wall_clock();
        std::thread::sleep(time);
        since
    }

    /// The latest messages on the state of the formation, for the message of a failed test.
    pub fn summary(&self) -> String {
        use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState};
        let log = self.log();
        let now = whorl_ros::wall_clock();
        let mut text = format!("{} messages were seen\n", log.seen.values().map(Vec::len).sum::<usize>());
        if let Some((at, m)) = log.latest::<FormationState>(route(0, Topic::FormationState)) {
            let age = now.seconds_since(at);
            text += &format!(
                "formation: {age:.2} s ago: phase {} step {} link age {:?} health {:?} mode {:?}\n",
                m.phase, m.step, m.link_age_s, m.estimate_health, m.control_mode
            );
        }
        for platform in 0..2 {
            if let Some((at, m)) = log.latest::<AttitudeEstimate>(route(platform, Topic::AttitudeEstimate)) {
                let age = now.seconds_since(at);
                text += &format!(
                    "platform {platform}: estimate {age:.2} s ago: health {} flags {}\n",
                    m.health, m.flags
                );
            }
            if let Some((at, m)) = log.latest::<ControlStatus>(route(platform, Topic::ControlStatus)) {
                let age = now.seconds_since(at);
                text += &format!(
                    "platform {platform}: control {age:.2} s ago: mode {} reason {}\n",
                    m.mode, m.reason
                );
            }
        }
        text
    }
}

/// Whether somebody's handshake does not end.
fn do_not_end(handshakes: &mut Handshakes, participant: &Participant) -> bool {
    let now = monotonic();
    while let Some(event) = participant.peer_event() {
        handshakes.peer(now, event);
    }
    handshakes.look(now, || participant.known_peers()).is_err()
}

fn take_all(readers: &[(Route, RawReader)], log: &Mutex<Log>) {
    for (route, reader) in readers {
        reader.drain_notifications();
        while let Ok(Some(sample)) = reader.take() {
            let message = Message::decode(route.topic.info().message_type, &sample.bytes).unwrap();
            let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
            log.seen.entry(*route).or_default().push((sample.receive_time, message));
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
