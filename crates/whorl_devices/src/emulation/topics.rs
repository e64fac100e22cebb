//! Topics of emulated devices.

use std::collections::VecDeque;
use std::os::fd::BorrowedFd;

use whorl_msgs::topics::{Message, MessageType};
use whorl_node::{ForeignTopic, ForeignTopics, TransportError};

use super::wire::Wire;
use super::world::World;
use super::{TopicEmulator, ports};
use crate::place::Place;

/// A node that is emulated.
pub(super) struct Topics {
    place: Place,
    read: Option<ForeignTopic>,
    write: Option<ForeignTopic>,
    /// While it is plugged in.
    pub(super) listener: Option<Box<dyn ForeignTopics>>,
    pub(super) wire: Wire,
    /// What is to be sent, and when.
    late: VecDeque<(i64, Vec<u8>)>,
    device: Box<dyn TopicEmulator>,
}

impl Topics {
    pub(super) fn new(
        place: Place,
        read: Option<ForeignTopic>,
        write: Option<ForeignTopic>,
        device: Box<dyn TopicEmulator>,
    ) -> Self {
        let wire = Wire::new(ports::NO_WIRE);
        Self { place, read, write, listener: None, wire, late: VecDeque::new(), device }
    }

    pub(super) fn plug(&mut self, in_place: bool) -> std::io::Result<()> {
        if !in_place {
            self.listener = None;
            self.late.clear();
        } else if self.listener.is_none() {
            self.listener = Some(self.join().map_err(std::io::Error::other)?);
        }
        Ok(())
    }

    fn join(&self) -> Result<Box<dyn ForeignTopics>, TransportError> {
        self.place.network()?.join(self.read.as_slice(), self.write.as_slice())
    }

    pub(super) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.listener.as_ref().map(|listener| listener.fd())
    }

    pub(super) fn receive(&mut self, now_ns: i64, world: &mut World) {
        let (Some(listener), Some(topic)) = (&mut self.listener, &self.read) else { return };
        let (device, message_type): (_, MessageType) = (&mut self.device, topic.message_type);
        // What cannot be read is lost, as on any network.
        let _ = listener.take(&mut |_, sample| {
            if let Ok(message) = Message::decode(message_type, sample.bytes) {
                device.message(now_ns, &message, world);
            }
        });
    }

    pub(super) fn due_ns(&self) -> Option<i64> {
        let late = self.late.front().map(|(at_ns, _)| *at_ns);
        [late, self.device.due_ns()].into_iter().flatten().min()
    }

    pub(super) fn step(&mut self, now_ns: i64, world: &mut World) {
        if self.device.due_ns().is_some_and(|due| due <= now_ns)
            && let Some((at_ns, message)) = self.device.act(now_ns, world)
        {
            let mut bytes = Vec::new();
            if message.encode_into(&mut bytes).is_ok() {
                self.late.extend(self.wire.spoil(at_ns, bytes));
            }
        }
        while self.late.front().is_some_and(|(at_ns, _)| *at_ns <= now_ns) {
            let sent = self.late.pop_front();
            if let (Some(listener), Some((_, bytes))) = (&self.listener, sent) {
                // A message whose header is spoilt is none.
                let _ = listener.publish_bytes(0, &bytes);
            }
        }
    }
}
