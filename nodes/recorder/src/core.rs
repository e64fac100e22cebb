//! The recorder as a state machine.

use whorl_bag::{BagError, RawSample, SequenceCounts};
use whorl_node::Timestamp;

use crate::{RecordedTopic, Sink};

/// Processes samples, ticks and the end of the recording, which the shell supplies.
#[derive(Debug)]
pub struct RecorderCore<S: Sink> {
    sink: S,
    topics: Vec<(RecordedTopic, S::Handle)>,
    recorded: u64,
    refused: u64,
    last_refusal: Option<String>,
    last_sample: Option<Timestamp>,
}

/// Status of the recording.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Status {
    /// Messages recorded.
    pub recorded: u64,
    /// Messages that were not recorded, after the recording stopped or because they were unusable.
    pub refused: u64,
    /// Reason for the latest of them.
    pub last_refusal: Option<String>,
    /// Reason why the recording stopped, if it did.
    pub stopped_by: Option<String>,
    /// Bytes that are safe if this process is killed.
    pub bytes_written: u64,
    /// Losses on the way to the recorder.
    pub sequence_counts: SequenceCounts,
    /// When the latest message arrived.
    pub last_sample: Option<Timestamp>,
}

impl<S: Sink> RecorderCore<S> {
    /// A recorder of these topics. A topic is addressed by its number in this list.
    ///
    /// # Errors
    /// When the sink refuses a topic.
    pub fn new(mut sink: S, topics: Vec<RecordedTopic>) -> Result<Self, BagError> {
        let topics = topics
            .into_iter()
            .map(|topic| {
                let handle = sink.add_topic(&topic)?;
                Ok((topic, handle))
            })
            .collect::<Result<_, BagError>>()?;
        Ok(Self { sink, topics, recorded: 0, refused: 0, last_refusal: None, last_sample: None })
    }

    /// The topics, in the order of their numbers.
    pub fn topics(&self) -> impl Iterator<Item = &RecordedTopic> {
        self.topics.iter().map(|(topic, _)| topic)
    }

    /// A message arrived on topic number `topic`. Messages that cannot be recorded are counted.
    pub fn sample(&mut self, topic: usize, sample: RawSample<'_>) {
        self.last_sample = Some(sample.log_time);
        let Some((_, handle)) = self.topics.get(topic) else {
            self.refuse(BagError::UnknownTopic { index: topic });
            return;
        };
        match self.sink.write(*handle, sample) {
            Ok(()) => self.recorded += 1,
            // The message that filled the disk is in the last chunk.
            Err(BagError::DiskFull { .. }) => self.recorded += 1,
            Err(error) => self.refuse(error),
        }
    }

    /// Time passes. Call it a few times a second.
    pub fn tick(&mut self, now: Timestamp) {
        if self.sink.stopped_by().is_none() {
            // An error stops the recording, and `status` tells why.
            let _ = self.sink.tick(now);
        }
    }

    /// The current status.
    #[must_use]
    pub fn status(&self) -> Status {
        Status {
            recorded: self.recorded,
            refused: self.refused,
            last_refusal: self.last_refusal.clone(),
            stopped_by: self.sink.stopped_by().map(str::to_owned),
            bytes_written: self.sink.bytes_written(),
            sequence_counts: self.sink.sequence_counts(),
            last_sample: self.last_sample,
        }
    }

    /// Ends the recording: returns the sink, to be closed.
    #[must_use]
    pub fn finish(self) -> S {
        self.sink
    }

    fn refuse(&mut self, error: BagError) {
        self.refused += 1;
        if !matches!(error, BagError::Stopped { .. }) {
            self.last_refusal = Some(error.to_string());
        }
    }
}
