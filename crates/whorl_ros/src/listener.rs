//! Topics that are not Whorl's own, for a thread that waits for them and for something else: drivers of sensors and
//! motors that other people wrote.

use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use mio::{Events, Interest, Poll, Token};
use whorl_msgs::topics::{Message, MessageType};

use crate::environment::Network;
use crate::error::RosError;
use crate::participant::{EndpointQos, Participant};
use crate::raw::{RawReader, RawSample, RawWriter};

/// Readers hear reliable and best-effort publishers alike.
const READS: EndpointQos = EndpointQos { reliable: false, depth: 10, transient_local: false };
/// Reliable and best-effort subscribers hear what is written.
const WRITES: EndpointQos = EndpointQos { reliable: true, depth: 1, transient_local: false };

/// A topic by its full name, and the type of its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ForeignTopic {
    /// With a leading slash: `/imu/data`.
    pub name: String,
    /// Type of its messages.
    pub message_type: MessageType,
}

/// Readers and writers of such topics. Whoever waits for [`Self::fd`] is woken by a message.
pub struct Listener {
    reads: Vec<(ForeignTopic, RawReader)>,
    writes: Vec<(ForeignTopic, RawWriter)>,
    poll: Poll,
    events: Events,
    bytes: Vec<u8>,
    participant: Participant,
}

impl Listener {
    /// Joins the network.
    ///
    /// # Errors
    /// When DDS or the operating system refuses.
    pub fn join(
        network: &Network,
        reads: &[ForeignTopic],
        writes: &[ForeignTopic],
    ) -> Result<Self, RosError> {
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

    /// Readable when there is a message.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.poll.registry().as_fd()
    }

    /// Hands over what has arrived: the number of the topic among those that are read, and the message as it came.
    ///
    /// # Errors
    /// When DDS fails.
    pub fn take(&mut self, mut each: impl FnMut(usize, RawSample)) -> Result<(), RosError> {
        self.poll
            .poll(&mut self.events, Some(Duration::ZERO))
            .map_err(RosError::io("waiting for a topic"))?;
        for (index, (_, reader)) in self.reads.iter().enumerate() {
            reader.drain_notifications();
            while let Some(sample) = reader.take()? {
                each(index, sample);
            }
        }
        Ok(())
    }

    /// Sends a message on the topic of this number among those that are written.
    ///
    /// # Errors
    /// When it cannot be encoded, or DDS fails.
    pub fn publish(&mut self, index: usize, message: &Message) -> Result<(), RosError> {
        let Some((_, writer)) = self.writes.get(index) else { return Ok(()) };
        message.encode_into(&mut self.bytes)?;
        writer.publish(&self.bytes)
    }

    /// Sends bytes as they are, which must begin with the header of CDR.
    ///
    /// # Errors
    /// When DDS fails, or the header is missing.
    pub fn publish_bytes(&self, index: usize, bytes: &[u8]) -> Result<(), RosError> {
        self.writes.get(index).map_or(Ok(()), |(_, writer)| writer.publish(bytes))
    }

    /// Whether the background threads of DDS still run.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.participant.is_alive()
    }

    /// Whether somebody reads the written topic of this number.
    #[must_use]
    pub fn is_heard(&self, index: usize) -> bool {
        let Some((topic, _)) = self.writes.get(index) else { return false };
        let readers = self.participant.discovered_readers();
        readers.iter().any(|reader| {
            reader.topic().as_deref() == Some(&topic.name)
                && reader.type_name().as_deref() == Some(topic.message_type.name())
        })
    }

    /// Why nothing comes on the read topic of this number, for people.
    #[must_use]
    pub fn why_silent(&self, index: usize) -> String {
        let Some((topic, _)) = self.reads.get(index) else { return String::new() };
        let writers = self.participant.discovered_writers();
        let types = writers.iter().filter(|writer| writer.topic().as_deref() == Some(&topic.name));
        self.why(
            topic,
            types.filter_map(|writer| writer.type_name()).collect(),
            ["publishes", "nothing comes"],
        )
    }

    /// Why nobody hears the written topic of this number, for people.
    #[must_use]
    pub fn why_unheard(&self, index: usize) -> String {
        let Some((topic, _)) = self.writes.get(index) else { return String::new() };
        let readers = self.participant.discovered_readers();
        let types = readers.iter().filter(|reader| reader.topic().as_deref() == Some(&topic.name));
        self.why(topic, types.filter_map(|r| r.type_name()).collect(), ["subscribes to", "nobody answers"])
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;
    use whorl_msgs::geometry_msgs::PoseStamped;
    use whorl_msgs::sensor_msgs::MagneticField;

    fn topic(name: &str, message_type: MessageType) -> ForeignTopic {
        ForeignTopic { name: name.to_owned(), message_type }
    }

    #[test]
    fn a_message_wakes_who_waits_and_silence_is_explained() {
        // Below are those of tests/node.rs.
        let network = Network::localhost(160);
        let field = topic("/a/field", MessageType::MagneticField);
        let wrong = topic("/a/pose", MessageType::PoseStamped);
        let mut hears = Listener::join(&network, &[field.clone(), wrong], &[]).unwrap();
        assert!(hears.why_silent(0).starts_with("no node publishes /a/field in ROS domain 160"));
        let other = topic("/a/pose", MessageType::MagneticField);
        let mut says = Listener::join(&network, &[], &[field, other]).unwrap();
        let message = MagneticField::default();
        let until = Instant::now() + Duration::from_secs(20);
        let mut got = Vec::new();
        while got.is_empty() && Instant::now() < until {
            says.publish(0, &message.clone().into()).unwrap();
            let mut fds = [rustix::event::PollFd::from_borrowed_fd(hears.fd(), rustix::event::PollFlags::IN)];
            let timeout = rustix::event::Timespec { tv_sec: 0, tv_nsec: 50_000_000 };
            rustix::event::poll(&mut fds, Some(&timeout)).unwrap();
            let woken = !fds[0].revents().is_empty();
            hears.take(|index, sample| got.push((woken, index, sample.bytes))).unwrap();
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
