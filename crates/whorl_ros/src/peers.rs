//! The other processes on the network.

use crate::raw::EndpointId;

/// A participant's id.
pub type ParticipantPrefix = [u8; 12];

/// A change among the other processes on the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PeerEvent {
    /// Keys are being exchanged with a participant; until that has ended it is not [`Self::Discovered`].
    Authenticating(ParticipantPrefix),
    /// The keys of a participant are not those of this network.
    Rejected(ParticipantPrefix),
    /// A participant was seen for the first time, or again after it had been dropped.
    Discovered(ParticipantPrefix),
    /// A participant said goodbye.
    Left(ParticipantPrefix),
    /// A participant was silent for longer than its lease.
    TimedOut(ParticipantPrefix),
    /// One of our writers found a reader.
    ReaderMatched {
        /// Ours.
        writer: EndpointId,
        /// Theirs.
        reader: EndpointId,
    },
    /// One of our readers found a writer.
    WriterMatched {
        /// Ours.
        reader: EndpointId,
        /// Theirs.
        writer: EndpointId,
    },
    /// A reader is gone.
    ReaderLost(EndpointId),
    /// A writer is gone.
    WriterLost(EndpointId),
}
