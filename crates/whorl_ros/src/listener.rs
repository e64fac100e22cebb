//! Topics that are not Whorl's own, for a thread that waits for them and for something else: drivers of sensors and
//! motors that other people wrote.

use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use mio::{Events, Interest, Poll, Token};
use whorl_msgs::topics::Message;
use whorl_node::{ForeignNetwork, ForeignSample, ForeignTopic, ForeignTopics, TransportError};

use crate::environment::Network;
use crate::error::RosError;
use crate::participant::{EndpointQos, Participant};
use crate::raw::{RawReader, RawSample, RawWriter};

/// Readers hear reliable and best-effort publishers alike.
const READS: EndpointQos = EndpointQos { reliable: false, depth: 10, transient_local: false };
/// Reliable and best-effort subscribers hear what is written.
const WRITES: EndpointQos = EndpointQos { reliable: true, depth: 1, transient_local: false };

/// The network that ROS 2's environment variables describe.
#[derive(Debug, Clone, Copy, Default)]
pub struct AmbientNetwork;

impl ForeignNetwork for AmbientNetwork {
    fn is_secured(&self) -> Result<bool, TransportError> {
        let network = Network::from_environment().map_err(told)?;
        // An enclave of this name need not exist: that security is asked for is enough.
        Ok(!matches!(network.secured("/"), Ok(network) if network.enclave.is_none()))
    }

    fn join(
        &self,
        reads: &[ForeignTopic],
        writes: &[ForeignTopic],
    ) -> Result<Box<dyn ForeignTopics>, TransportError> {
        let network = Network::from_environment().map_err(told)?;
        Ok(Box::new(Listener::join(&network, reads, writes).map_err(told)?))
    }
}

fn told(error: impl Into<RosError>) -> TransportError {
    TransportError(error.into().to_string())
}

/// Readers and writers of such topics. Whoever waits for [`Self::fd`] is woken by a message.
struct Listener {
    reads: Vec<(ForeignTopic, RawReader)>,
    writes: Vec<(ForeignTopic, RawWriter)>,
    poll: Poll,
    events: Events,
    bytes: Vec<u8>,
    participant: Participant,
}

impl Listener {
    fn join(network: &Network, reads: &[ForeignTopic], writes: &[ForeignTopic]) -> Result<Self, RosError> {
        let (participant, (reads, writes)) = Participant::with(network, |participant| {
            let read = |topic: &ForeignTopic| {
                Ok((topic.clone(), participant.reader(&topic.name, topic.message_type.name(), READS)?))
            };
            let write = |topic: &ForeignTopic| {
                Ok((topic.clone(), participant.writer(&topic.name, topic.message_type.name(), WRITES)?))
            };
            let reads = reads.iter().map(read).collect::<Result<Vec<_>, RosError>>()?;
            Ok((reads, writes.iter().map(write).collect::<Result<Vec<_>, RosError>>()?))
        })?;
        let poll = Poll::new().map_err(RosError::io("making a poll"))?;
        let mut listener =
            Self { reads, writes, poll, events: Events::with_capacity(16), bytes: Vec::new(), participant };
        for (index, (_, reader)) in listener.reads.iter_mut().enumerate() {
            let registered = listener.poll.registry().register(reader, Token(index), Interest::READABLE);
            registered.map_err(RosError::io("waiting for a topic"))?;
        }
        Ok(listener)
    }

    fn why(&self, topic: &ForeignTopic, types: Vec<String>, [does, silent]: [&str; 2]) -> String {
        let ForeignTopic { name, message_type } = topic;
        let wanted = message_type.name();
        let network = self.participant.network();
        if types.iter().any(|other| other == wanted) {
            return format!("a node {does} {name}, but {silent}");
        }
        if let Some(other) = types.first() {
            return format!("{name} has messages of type {other}; needed: {wanted}");
        }
        let reach = if network.is_localhost() {
            " on this computer (ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET on both sides looks further)"
        } else {
            ""
        };
        format!("no node {does} {name} in ROS domain {}{reach}", network.domain_id)
    }
}

impl ForeignTopics for Listener {
    fn fd(&self) -> BorrowedFd<'_> {
        self.poll.registry().as_fd()
    }

    fn take(&mut self, each: &mut dyn FnMut(usize, ForeignSample<'_>)) -> Result<(), TransportError> {
        let polled = self.poll.poll(&mut self.events, Some(Duration::ZERO));
        polled.map_err(RosError::io("waiting for a topic")).map_err(told)?;
        for (index, (_, reader)) in self.reads.iter().enumerate() {
            reader.drain_notifications();
            while let Some(RawSample { bytes, writer, receive_time, .. }) = reader.take().map_err(told)? {
                each(index, ForeignSample { bytes: &bytes, writer: writer.0, receive_time });
            }
        }
        Ok(())
    }

    fn publish(&mut self, index: usize, message: &Message) -> Result<(), TransportError> {
        let Some((_, writer)) = self.writes.get(index) else { return Ok(()) };
        message.encode_into(&mut self.bytes).map_err(told)?;
        writer.publish(&self.bytes).map_err(told)
    }

    fn publish_bytes(&self, index: usize, bytes: &[u8]) -> Result<(), TransportError> {
        self.writes.get(index).map_or(Ok(()), |(_, writer)| writer.publish(bytes)).map_err(told)
    }

    fn is_alive(&self) -> bool {
        self.participant.is_alive()
    }

    fn is_heard(&self, index: usize) -> bool {
        let Some((topic, _)) = self.writes.get(index) else { return false };
        let readers = self.participant.discovered_readers();
        readers.iter().any(|reader| {
            reader.topic().as_deref() == Some(&topic.name)
                && reader.type_name().as_deref() == Some(topic.message_type.name())
        })
    }

    fn why_silent(&self, index: usize) -> String {
        let Some((topic, _)) = self.reads.get(index) else { return String::new() };
        let writers = self.participant.discovered_writers();
        let types = writers.iter().filter(|writer| writer.topic().as_deref() == Some(&topic.name));
        self.why(
            topic,
            types.filter_map(|writer| writer.type_name()).collect(),
            ["publishes", "nothing comes"],
        )
    }

    fn why_unheard(&self, index: usize) -> String {
        let Some((topic, _)) = self.writes.get(index) else { return String::new() };
        let readers = self.participant.discovered_readers();
        let types = readers.iter().filter(|reader| reader.topic().as_deref() == Some(&topic.name));
        self.why(topic, types.filter_map(|r| r.type_name()).collect(), ["subscribes to", "nobody answers"])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;
    use whorl_msgs::geometry_msgs::PoseStamped;
    use whorl_msgs::sensor_msgs::MagneticField;
    use whorl_msgs::topics::MessageType;

    fn topic(name: &str, message_type: MessageType) -> ForeignTopic {
        ForeignTopic { name: name.to_owned(), message_type }
    }

    #[test]
    fn a_message_wakes_who_waits_and_silence_is_explained() {
        let domain = whorl_tests::Domain::take();
        let network = Network::localhost(domain.id);
        let field = topic("/a/field", MessageType::MagneticField);
        let wrong = topic("/a/pose", MessageType::PoseStamped);
        let mut hears = Listener::join(&network, &[field.clone(), wrong], &[]).unwrap();
        assert!(
            hears
                .why_silent(0)
                .starts_with(&format!("no node publishes /a/field in ROS domain {}", domain.id))
        );
        let other = topic("/a/pose", MessageType::MagneticField);
        let mut says = Listener::join(&network, &[], &[field, other]).unwrap();
        let message = MagneticField::default();
        let until = Instant::now() + Duration::from_secs(120);
        let mut got = Vec::new();
        while got.is_empty() && Instant::now() < until {
            says.publish(0, &message.clone().into()).unwrap();
            let mut fds = [rustix::event::PollFd::from_borrowed_fd(hears.fd(), rustix::event::PollFlags::IN)];
            let timeout = rustix::event::Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
            rustix::event::poll(&mut fds, Some(&timeout)).unwrap();
            let woken = !fds[0].revents().is_empty();
            hears.take(&mut |index, sample| got.push((woken, index, sample.bytes.to_vec()))).unwrap();
        }
        let (woken, index, bytes) = got.first().expect("no message");
        assert!(*woken && *index == 0);
        assert_eq!(Message::decode(MessageType::MagneticField, bytes).unwrap(), message.into());
        assert!(says.is_heard(0) && !says.is_heard(1));
        assert!(hears.why_silent(0).contains("but nothing comes"));
        let why = hears.why_silent(1);
        assert!(
            why.contains("sensor_msgs/msg/MagneticField; needed: geometry_msgs/msg/PoseStamped"),
            "{why}"
        );
        let _ = PoseStamped::default();
    }
}
