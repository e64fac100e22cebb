//! Recording in the background.

use std::mem::take;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use whorl_msgs::topics::{Message, Route};
use whorl_node::Timestamp;

use crate::run_writer::RunWriter;
use crate::{BagError, Manifest};

/// Messages after which a batch is handed over: large enough that handing over costs nothing.
const BATCH_MESSAGES: usize = 1024;
/// Queue of batches; when it is full, the sender waits for the disk.
const BATCHES: usize = 4;

/// Messages in order.
type Batch = Vec<(Route, Timestamp, Arc<Message>)>;

/// A [`RunWriter`] on a thread of its own: messages are encoded and written there, in the same order. For a simulation,
/// which otherwise spends much of its time waiting for the operating system.
///
/// Dropped without [`Self::finish`] it writes what it has handed over and leaves the run as a killed recorder does.
pub struct BackgroundRunWriter {
    batch: Batch,
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
                batch.drain(..).try_for_each(|(route, log_time, message)| {
                    writer.write_message(route, log_time, &message)
                })?;
                // No one waits for the last batches.
                let _ = give_back.try_send(batch);
                Ok(())
            });
            (writer, result)
        });
        Self { batch: Batch::new(), filled, emptied, thread }
    }

    /// Records a message, as [`RunWriter::write_message`].
    ///
    /// # Errors
    /// [`BagError::Background`] when an earlier message could not be written: [`Self::finish`] says why.
    pub fn write_message(
        &mut self,
        route: Route,
        log_time: Timestamp,
        message: &Arc<Message>,
    ) -> Result<(), BagError> {
        self.batch.push((route, log_time, Arc::clone(message)));
        if self.batch.len() >= BATCH_MESSAGES { self.hand_over() } else { Ok(()) }
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
