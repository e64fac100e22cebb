//! Recording in the background.

use std::mem::take;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use whorl_msgs::topics::{Message, Route};
use whorl_node::Timestamp;

use crate::run_writer::{RawSample, RunWriter};
use crate::{BagError, Manifest};

/// Bytes after which a batch is handed over: large enough that handing over costs nothing.
const BATCH_BYTES: usize = 256 << 10;
/// Queue of batches; when it is full, the sender waits for the disk.
const BATCHES: usize = 4;

/// Encoded messages in order.
#[derive(Default)]
struct Batch {
    bytes: Vec<u8>,
    messages: Vec<Recorded>,
}

struct Recorded {
    route: Route,
    log_time: Timestamp,
    sequence: Option<u64>,
    /// Where its bytes end; they begin where those of the one before end.
    end: usize,
}

/// A [`RunWriter`] on a thread of its own: messages are encoded at once and written later, in the same
/// order. For a simulation, which otherwise spends much of its time waiting for the operating system.
///
/// Dropped without [`Self::finish`] it writes what it has and leaves the run as a killed recorder does.
pub struct BackgroundRunWriter {
    batch: Batch,
    encoded: Vec<u8>,
    filled: SyncSender<Batch>,
    emptied: Receiver<Batch>,
    thread: JoinHandle<(RunWriter, Result<(), BagError>)>,
}

impl BackgroundRunWriter {
    /// Takes over the writer.
    #[must_use]
    pub fn new(mut writer: RunWriter) -> Self {
        let (filled, to_write) = sync_channel::<Batch>(BATCHES);
        let (give_back, emptied) = sync_channel(BATCHES);
        let thread = std::thread::spawn(move || {
            let result = to_write.iter().try_for_each(|mut batch| {
                batch.write(&mut writer)?;
                // No one waits for the last batches.
                let _ = give_back.try_send(batch);
                Ok(())
            });
            (writer, result)
        });
        Self { batch: Batch::default(), encoded: Vec::new(), filled, emptied, thread }
    }

    /// Records a message, as [`RunWriter::write_message`].
    ///
    /// # Errors
    /// [`BagError::Encode`]; [`BagError::Background`] when an earlier message could not be written:
    /// [`Self::finish`] says why.
    pub fn write_message(
        &mut self,
        route: Route,
        log_time: Timestamp,
        message: &Message,
    ) -> Result<(), BagError> {
        message
            .encode_into(&mut self.encoded)
            .map_err(|source| BagError::Encode { topic: route.topic.info().name.to_owned(), source })?;
        self.batch.bytes.extend_from_slice(&self.encoded);
        let (sequence, end) = (message.sequence(), self.batch.bytes.len());
        self.batch.messages.push(Recorded { route, log_time, sequence, end });
        if end >= BATCH_BYTES { self.hand_over() } else { Ok(()) }
    }

    fn hand_over(&mut self) -> Result<(), BagError> {
        self.filled.send(take(&mut self.batch)).map_err(|_| BagError::Background)?;
        self.batch = self.emptied.try_recv().unwrap_or_default();
        Ok(())
    }

    /// Writes what is left and closes the run, as [`RunWriter::finish`].
    ///
    /// # Errors
    /// The first error of any message, after closing the partial run; otherwise that of closing.
    pub fn finish(mut self, stop_utc: Timestamp) -> Result<Manifest, BagError> {
        // If the thread has ended, it says why below.
        let _ = self.hand_over();
        let Self { filled, thread, .. } = self;
        drop(filled);
        let (writer, result) = thread.join().map_err(|_| BagError::Background)?;
        let manifest = writer.finish(stop_utc);
        result.and(manifest)
    }
}

impl Batch {
    /// Writes and empties it.
    fn write(&mut self, writer: &mut RunWriter) -> Result<(), BagError> {
        let mut start = 0;
        for message in self.messages.drain(..) {
            let handle = writer.add_route(message.route)?;
            let cdr = self.bytes.get(start..message.end).unwrap_or_default();
            start = message.end;
            writer.write_raw(
                handle,
                RawSample {
                    log_time: message.log_time,
                    publish_time: message.log_time,
                    origin: message.sequence.map(|sequence| (0, sequence)),
                    cdr,
                },
            )?;
        }
        self.bytes.clear();
        Ok(())
    }
}
