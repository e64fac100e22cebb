//! Topics of nodes that other people wrote: what a driver of devices needs of a transport, so that drivers know none.

use std::fmt::Debug;
use std::os::fd::BorrowedFd;

use thiserror::Error;
use whorl_msgs::topics::{Message, MessageType};

use crate::Timestamp;

/// A topic by its full name, and the type of its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ForeignTopic {
    /// With a leading slash: `/imu/data`.
    pub name: String,
    /// Type of its messages.
    pub message_type: MessageType,
}

/// What a transport or the operating system has refused, for people.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct TransportError(pub String);

/// One message as it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ForeignSample<'a> {
    /// CDR with its 4-byte header, as [`Message::decode`] takes it.
    pub bytes: &'a [u8],
    /// Who wrote it.
    pub writer: [u8; 16],
    /// Time of day at which it was taken.
    pub receive_time: Timestamp,
}

/// A network on which there may be such topics.
pub trait ForeignNetwork: Debug + Send + Sync {
    /// Whether its traffic is secured, so that nodes without keys are not heard.
    ///
    /// # Errors
    /// When that cannot be told.
    fn is_secured(&self) -> Result<bool, TransportError>;

    /// Joins it as a participant that reads and writes these topics.
    ///
    /// # Errors
    /// When the transport or the operating system refuses.
    fn join(
        &self,
        reads: &[ForeignTopic],
        writes: &[ForeignTopic],
    ) -> Result<Box<dyn ForeignTopics>, TransportError>;
}

/// Readers and writers of such topics, by their numbers in the lists with which they were joined. They leave the network
/// when this is dropped.
pub trait ForeignTopics: Send {
    /// Readable when there is a message.
    fn fd(&self) -> BorrowedFd<'_>;

    /// Hands over what has arrived, with the number of its topic.
    ///
    /// # Errors
    /// When the transport fails.
    fn take(&mut self, each: &mut dyn FnMut(usize, ForeignSample<'_>)) -> Result<(), TransportError>;

    /// Sends a message.
    ///
    /// # Errors
    /// When it cannot be encoded, or the transport fails.
    fn publish(&mut self, index: usize, message: &Message) -> Result<(), TransportError>;

    /// Sends bytes as they are, which must begin with the header of CDR.
    ///
    /// # Errors
    /// When the transport fails, or the header is missing.
    fn publish_bytes(&self, index: usize, bytes: &[u8]) -> Result<(), TransportError>;

    /// Whether the transport still works in the background.
    fn is_alive(&self) -> bool;

    /// Whether somebody reads a written topic.
    fn is_heard(&self, index: usize) -> bool;

    /// Why nothing comes on a read topic, for people.
    fn why_silent(&self, index: usize) -> String;

    /// Why nobody hears a written topic, for people.
    fn why_unheard(&self, index: usize) -> String;
}
