//! Where recorded messages go.

use whorl_bag::{BagError, RawSample, RunTopicHandle, RunWriter, SequenceCounts, offered_qos_profiles};
use whorl_node::Timestamp;

use crate::RecordedTopic;

/// Interface that the recorder writes to.
pub trait Sink {
    /// A topic of the recording.
    type Handle: Copy;

    /// Adds a topic.
    ///
    /// # Errors
    /// When it cannot be recorded.
    fn add_topic(&mut self, topic: &RecordedTopic) -> Result<Self::Handle, BagError>;

    /// Records a message.
    ///
    /// # Errors
    /// When it was not recorded; see [`Self::stopped_by`] for whether the recording goes on.
    fn write(&mut self, topic: Self::Handle, sample: RawSample<'_>) -> Result<(), BagError>;

    /// Called a few times a second, so that buffered data is written in time.
    ///
    /// # Errors
    /// When it cannot be written.
    fn tick(&mut self, now: Timestamp) -> Result<(), BagError>;

    /// Why the recording stopped, if it did.
    fn stopped_by(&self) -> Option<&str>;

    /// Bytes that are safe if this process is killed.
    fn bytes_written(&self) -> u64;

    /// Losses so far.
    fn sequence_counts(&self) -> SequenceCounts;
}

impl Sink for RunWriter {
    type Handle = RunTopicHandle;

    fn add_topic(&mut self, topic: &RecordedTopic) -> Result<Self::Handle, BagError> {
        match topic.route {
            Some(route) => self.add_route(route),
            None => {
                Self::add_topic(self, &topic.name, &topic.type_name, &offered_qos_profiles(topic.qos), None)
            }
        }
    }

    fn write(&mut self, topic: Self::Handle, sample: RawSample<'_>) -> Result<(), BagError> {
        self.write_raw(topic, sample)
    }

    fn tick(&mut self, now: Timestamp) -> Result<(), BagError> {
        Self::tick(self, now)
    }

    fn stopped_by(&self) -> Option<&str> {
        Self::stopped_by(self)
    }

    fn bytes_written(&self) -> u64 {
        Self::bytes_written(self)
    }

    fn sequence_counts(&self) -> SequenceCounts {
        Self::sequence_counts(self)
    }
}
