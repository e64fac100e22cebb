//! Completes a bag whose writer was killed.

use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

use mcap::records::MessageHeader;
use whorl_files::NewFile;

use crate::metadata::mcap_files;
use crate::reader::{FileMessages, MessageFilter, open_contents, topic_of};
use crate::storage::{Reserve, lock};
use crate::unpacked::is_packed;
use crate::{BagError, BagReader, BagTopic};

/// What [`recover`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Recovery {
    /// Files that were incomplete and are complete now.
    pub files: usize,
    /// Messages in them.
    pub messages: u64,
    /// Bytes of half-written records that were removed.
    pub bytes_cut_off: u64,
    /// Damaged chunks that were removed.
    pub damaged_chunks: u64,
}

/// Rewrites the incomplete files of a bag with index and footer, and `metadata.yaml`, so that every reader
/// can open it. Complete bags are not changed. Each file is replaced in one step: at any time either the old
/// or the new one exists. Needs as much free space as the file is long.
///
/// # Errors
/// [`BagError::InUse`] while the bag is being recorded; [`BagError::DiskFull`]; as [`crate::BagReader::open`].
pub fn recover(bag: &Path) -> Result<Recovery, BagError> {
    let mut recovery = Recovery::default();
    let files = mcap_files(bag)?;
    // One that was compressed was complete before.
    for path in files.iter().filter(|path| !is_packed(path)) {
        let (file, contents) = open_contents(path)?;
        lock(&file, path)?;
        if contents.integrity.complete {
            continue;
        }
        recovery.files += 1;
        recovery.messages += rewrite(path)?;
        recovery.bytes_cut_off += contents.integrity.bytes_cut_off;
        recovery.damaged_chunks += contents.integrity.damaged_chunks;
    }
    // Left behind by the killed writer; nobody holds the lock of its file any more.
    if recovery.files > 0 {
        BagReader::open(bag)?.metadata().write(bag)?;
        let _ = std::fs::remove_file(bag.join(Reserve::FILE));
    }
    Ok(recovery)
}

/// Copies the readable messages, in the order of their log time, and takes the original's place. Returns their number.
fn rewrite(path: &Path) -> Result<u64, BagError> {
    let mut file = NewFile::create(path).map_err(|e| BagError::io("cannot create", path, e))?;
    let messages = copy(path, &mut file)?;
    file.finish().map_err(|e| BagError::io("cannot replace", path, e))?;
    Ok(messages)
}

fn copy(path: &Path, to: &mut NewFile) -> Result<u64, BagError> {
    let contents = open_contents(path)?.1;
    let mut writer = mcap::WriteOptions::new()
        .profile("ros2")
        .library(concat!("whorl ", env!("CARGO_PKG_VERSION")))
        .compression(None)
        .create(BufWriter::new(to))
        .map_err(BagError::mcap(path))?;
    let mut channels: Vec<_> = contents.summary.channels.values().collect();
    channels.sort_by_key(|channel| channel.id);
    let mut topics: Vec<Arc<BagTopic>> = Vec::new();
    for channel in channels {
        if topics.iter().any(|topic| topic.name == channel.topic) {
            continue;
        }
        let schema = match &channel.schema {
            Some(schema) => writer
                .add_schema(&schema.name, &schema.encoding, &schema.data)
                .map_err(BagError::mcap(path))?,
            None => 0,
        };
        let id = writer
            .add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata)
            .map_err(BagError::mcap(path))?;
        // Channels are numbered from 1 in the order in which they are added.
        debug_assert_eq!(usize::from(id), topics.len() + 1);
        topics.push(Arc::new(topic_of(channel, 0)));
    }
    let mut count = 0;
    let mut messages = FileMessages::open(path.to_owned(), &MessageFilter::default(), &topics)?;
    while let Some(message) = messages.next() {
        let message = message?;
        let Some(index) = topics.iter().position(|topic| Arc::ptr_eq(topic, &message.topic)) else {
            continue;
        };
        let time = |t: whorl_node::Timestamp| u64::try_from(t.0).unwrap_or(0);
        let header = MessageHeader {
            channel_id: u16::try_from(index + 1).unwrap_or(u16::MAX),
            sequence: message.sequence,
            log_time: time(message.log_time),
            publish_time: time(message.publish_time),
        };
        writer.write_to_known_channel(&header, &message.cdr).map_err(BagError::mcap(path))?;
        count += 1;
    }
    writer.finish().map_err(BagError::mcap(path))?;
    Ok(count)
}
