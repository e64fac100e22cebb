//! Writing bags.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use mcap::records::MessageHeader;
use whorl_msgs::definitions;
use whorl_node::Timestamp;

use crate::error::is_disk_full;
use crate::metadata::both;
use crate::storage::{AppendSink, LockedFile, Reserve, Storage};
use crate::{BagError, BagFile, BagMetadata, BagTopic};

/// Compression of chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// None: fastest to write.
    #[default]
    None,
    /// LZ4: smaller, and understood by all readers of ROS 2 bags.
    Lz4,
}

/// How a bag is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BagOptions {
    /// Compression of chunks.
    pub compression: Compression,
    /// A chunk is closed and handed to the operating system when it holds this many bytes ...
    pub max_chunk_bytes: usize,
    /// ... or when its first message is this old, by log time or by the clock of [`BagWriter::tick`]. A
    /// killed process loses at most this much, and the interval between two ticks.
    pub max_chunk_age: Duration,
    /// The next file of the bag begins when the first message of this one is this old, by log time. `None`: there is one
    /// file. Where each chunk lies is kept in memory until a file is complete: with 43 topics about 10 MB for each hour.
    pub max_file_age: Option<Duration>,
}

impl Default for BagOptions {
    fn default() -> Self {
        Self {
            compression: Compression::None,
            max_chunk_bytes: 768 << 10,
            max_chunk_age: Duration::from_millis(500),
            max_file_age: None,
        }
    }
}

/// A topic of a [`BagWriter`]; see [`BagWriter::add_topic`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TopicHandle(pub(crate) usize);

/// A message to record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample<'a> {
    /// When it was received (or, in simulation, sent): readers go by this.
    pub log_time: Timestamp,
    /// When its writer sent it; the log time if that is not known.
    pub publish_time: Timestamp,
    /// The writer's sequence number; 0 if there is none. MCAP keeps the low 32 bits.
    pub sequence: u64,
    /// The message as CDR, with its 4-byte header.
    pub cdr: &'a [u8],
}

/// Writes a rosbag2 directory: `metadata.yaml`, `<name>_0.mcap` and, where the bag is split, `<name>_1.mcap` and so on.
///
/// Only whole chunks reach the file, so a process that is killed leaves a file that [`crate::BagReader`]
/// reads up to the last chunk, and that [`crate::recover`] makes complete for every other reader. Nothing is
/// synchronised to the disk: the operating system does that in its own time.
///
/// **Types without a definition** (anything that `whorl_msgs` does not define) are recorded with their type
/// name and an empty schema, as rosbag2 does when it finds no definition: `ros2 bag play` works, readers
/// that need the schema must bring their own.
///
/// **A full disk** stops the recording with [`BagError::DiskFull`]: what fits is kept, the space set aside at
/// the start is used to write the index and the metadata, and all later writes say [`BagError::Stopped`].
/// Recording does not resume by itself: a bag with a silent hole in it is worse than one that ends.
pub struct BagWriter {
    inner: Core<LockedFile>,
    options: BagOptions,
    directory: PathBuf,
    /// Files that are complete, and their bytes.
    complete: Vec<BagFile>,
    complete_bytes: u64,
    reserve: Option<Reserve>,
}

impl BagWriter {
    /// Creates the directory (its parent must exist) and an empty bag that is already readable.
    ///
    /// # Errors
    /// [`BagError::Exists`] when the directory holds a bag; [`BagError::Io`].
    pub fn create(directory: &Path, options: BagOptions) -> Result<Self, BagError> {
        match std::fs::create_dir(directory) {
            Ok(()) => {}
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(BagError::io("cannot create", directory, e)),
        }
        let mut writer = Self {
            inner: Self::file(directory, 0, options)?,
            options,
            directory: directory.to_owned(),
            complete: Vec::new(),
            complete_bytes: 0,
            reserve: Some(Reserve::set_aside(directory)),
        };
        writer.inner.flush()?;
        writer.metadata().write(directory)?;
        Ok(writer)
    }

    /// The bag's file of this number.
    fn file(directory: &Path, number: usize, options: BagOptions) -> Result<Core<LockedFile>, BagError> {
        let name = directory.file_name().map_or_else(|| "bag".into(), |n| n.to_string_lossy().into_owned());
        let path = directory.join(format!("{name}_{number}.mcap"));
        Core::new(LockedFile::create(&path)?, path, options)
    }

    /// Completes this file and goes on in a new one with the same topics.
    fn next_file(&mut self) -> Result<(), BagError> {
        let mut next = Self::file(&self.directory, self.complete.len() + 1, self.options)?;
        for (_, topic) in &self.inner.topics {
            next.add_topic(&topic.name, &topic.type_name, &topic.offered_qos_profiles)?;
        }
        for ((_, topic), (_, before)) in next.topics.iter_mut().zip(&self.inner.topics) {
            topic.message_count = before.message_count;
        }
        next.flush()?;
        let mut complete = std::mem::replace(&mut self.inner, next);
        let closed = complete.close();
        self.complete.push(complete.described());
        self.complete_bytes += complete.bytes_written();
        // A reader finds all files by now; those that are not complete it reads up to their last chunk.
        closed.and_then(|()| self.metadata().write(&self.directory))
    }

    /// Adds a topic, or finds it again.
    ///
    /// `offered_qos_profiles` is YAML as [`crate::offered_qos_profiles`] writes it, or empty.
    ///
    /// # Errors
    /// [`BagError::TypeConflict`] when the topic was added with another type.
    pub fn add_topic(
        &mut self,
        name: &str,
        type_name: &str,
        offered_qos_profiles: &str,
    ) -> Result<TopicHandle, BagError> {
        self.inner.add_topic(name, type_name, offered_qos_profiles)
    }

    /// Appends a message. Log times may go back; readers sort.
    ///
    /// # Errors
    /// [`BagError::DiskFull`] once, then [`BagError::Stopped`]; [`BagError::BeforeEpoch`] for a negative
    /// time, after which recording goes on.
    pub fn write(&mut self, topic: TopicHandle, sample: Sample<'_>) -> Result<(), BagError> {
        if self.is_next_file_due(sample.log_time) && !self.inner.stopped {
            let result = self.next_file();
            self.inner.stopped = result.is_err();
            self.after(result)?;
        }
        let result = self.inner.write(topic, sample);
        self.after(result)
    }

    fn is_next_file_due(&self, log_time: Timestamp) -> bool {
        let (Some(most), Some((first, _))) = (self.options.max_file_age, self.inner.bounds) else {
            return false;
        };
        u64::try_from(log_time.0).is_ok_and(|now| Duration::from_nanos(now.saturating_sub(first)) >= most)
    }

    /// Closes the chunk in progress if it is older than [`BagOptions::max_chunk_age`] by this clock. Call it
    /// a few times a second with any clock that does not go back.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn tick(&mut self, now: Timestamp) -> Result<(), BagError> {
        let result = self.inner.tick(now);
        self.after(result)
    }

    /// Hands everything so far to the operating system.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn flush(&mut self) -> Result<(), BagError> {
        let result = self.inner.flush();
        self.after(result)
    }

    /// Bytes in the files by now.
    #[must_use]
    pub fn bytes_written(&self) -> u64 {
        self.complete_bytes + self.inner.bytes_written()
    }

    /// Whether an error has stopped the recording.
    #[must_use]
    pub fn stopped(&self) -> bool {
        self.inner.stopped
    }

    /// Counts and times so far.
    #[must_use]
    pub fn metadata(&self) -> BagMetadata {
        let topics = self.inner.topics.iter().map(|(_, topic)| topic.clone()).collect();
        let files = self.complete.iter().cloned().chain([self.inner.described()]);
        BagMetadata::new(topics, files.collect())
    }

    /// Closes the bag: index, footer, `metadata.yaml`. After an earlier error this is done already.
    ///
    /// # Errors
    /// When the rest cannot be written. What was written before stays readable, see [`crate::recover`].
    pub fn finish(self) -> Result<BagMetadata, BagError> {
        self.finish_with_size().0
    }

    /// As [`Self::finish`], and the bytes in the file.
    pub(crate) fn finish_with_size(mut self) -> (Result<BagMetadata, BagError>, u64) {
        let result = if self.inner.stopped { Ok(()) } else { self.close() };
        (result.map(|()| self.metadata()), self.bytes_written())
    }

    /// After an error that stops the recording: closes the bag with the space set aside for that.
    fn after(&mut self, result: Result<(), BagError>) -> Result<(), BagError> {
        if result.is_err() && self.inner.stopped {
            self.reserve = None;
            // If even that fails, the file ends at the last whole chunk: `recover` writes the rest.
            let _ = self.close();
        }
        result
    }

    fn close(&mut self) -> Result<(), BagError> {
        let result = self.inner.close();
        self.reserve = None;
        self.metadata().write(&self.directory)?;
        result
    }
}

/// The writer without its directory, over any storage.
pub(crate) struct Core<S: Storage> {
    /// `None` once closed.
    mcap: Option<mcap::Writer<AppendSink<S>>>,
    path: PathBuf,
    options: BagOptions,
    topics: Vec<(u16, BagTopic)>,
    index: HashMap<String, usize>,
    chunk: Chunk,
    bounds: Option<(u64, u64)>,
    count: u64,
    written: Arc<AtomicU64>,
    stopped: bool,
}

/// The chunk in progress.
#[derive(Default)]
struct Chunk {
    bytes: usize,
    first_log_ns: Option<u64>,
    first_tick: Option<Timestamp>,
}

/// Bytes of an MCAP message record beside its data, and of its entry in the index.
const RECORD_OVERHEAD: usize = 31 + 16;

impl<S: Storage> Core<S> {
    pub fn new(storage: S, path: PathBuf, options: BagOptions) -> Result<Self, BagError> {
        let write_options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("whorl ", env!("CARGO_PKG_VERSION")))
            .compression(match options.compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
            })
            // Chunks are closed by us, and go to the sink in one piece.
            .chunk_size(None)
            .disable_seeking(true)
            // Chunks carry their own checksums.
            .calculate_data_section_crc(false);
        let sink = AppendSink::new(storage);
        let written = sink.written();
        let mcap = write_options.create(sink).map_err(BagError::mcap(&path))?;
        Ok(Self {
            mcap: Some(mcap),
            path,
            options,
            topics: Vec::new(),
            index: HashMap::new(),
            chunk: Chunk::default(),
            bounds: None,
            count: 0,
            written,
            stopped: false,
        })
    }

    pub fn add_topic(&mut self, name: &str, type_name: &str, qos: &str) -> Result<TopicHandle, BagError> {
        if let Some(&index) = self.index.get(name) {
            let known = self.topics.get(index).map_or("", |(_, t)| &t.type_name);
            if known != type_name {
                return Err(BagError::TypeConflict {
                    topic: name.to_owned(),
                    known: known.to_owned(),
                    offered: type_name.to_owned(),
                });
            }
            return Ok(TopicHandle(index));
        }
        let path = &self.path;
        let mcap = self.mcap.as_mut().ok_or_else(|| BagError::Stopped { path: path.clone() })?;
        let schema = match definitions::find(type_name) {
            Some(definition) => mcap.add_schema(type_name, "ros2msg", definition.schema().as_bytes()),
            None => mcap.add_schema(type_name, "", &[]),
        };
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), qos.to_owned())]);
        let channel = schema
            .and_then(|schema| mcap.add_channel(schema, name, "cdr", &metadata))
            .map_err(BagError::mcap(path))?;
        let index = self.topics.len();
        self.index.insert(name.to_owned(), index);
        let topic = BagTopic {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            encoding: "cdr".to_owned(),
            offered_qos_profiles: qos.to_owned(),
            message_count: 0,
        };
        self.topics.push((channel, topic));
        Ok(TopicHandle(index))
    }

    pub fn write(&mut self, topic: TopicHandle, sample: Sample<'_>) -> Result<(), BagError> {
        let (channel_id, entry) =
            self.topics.get_mut(topic.0).ok_or(BagError::UnknownTopic { index: topic.0 })?;
        let unsigned = |time: Timestamp| {
            u64::try_from(time.0)
                .map_err(|_| BagError::BeforeEpoch { topic: entry.name.clone(), time_ns: time.0 })
        };
        let (log_time, publish_time) = (unsigned(sample.log_time)?, unsigned(sample.publish_time)?);
        let channel_id = *channel_id;
        if self.stopped {
            return Err(BagError::Stopped { path: self.path.clone() });
        }
        let age_ns = u64::try_from(self.options.max_chunk_age.as_nanos()).unwrap_or(u64::MAX);
        if self.chunk.first_log_ns.is_some_and(|first| log_time.abs_diff(first) >= age_ns) {
            self.flush()?;
        }
        let path = &self.path;
        let mcap = self.mcap.as_mut().ok_or_else(|| BagError::Stopped { path: path.clone() })?;
        // The low 32 bits are what MCAP can hold.
        let sequence = sample.sequence as u32;
        mcap.write_to_known_channel(
            &MessageHeader { channel_id, sequence, log_time, publish_time },
            sample.cdr,
        )
        .map_err(BagError::mcap(path))?;
        if let Some((_, entry)) = self.topics.get_mut(topic.0) {
            entry.message_count += 1;
        }
        self.count += 1;
        let now = (log_time, log_time);
        self.bounds = Some(self.bounds.map_or(now, |before| both(before, now)));
        self.chunk.first_log_ns.get_or_insert(log_time);
        self.chunk.bytes += sample.cdr.len() + RECORD_OVERHEAD;
        if self.chunk.bytes >= self.options.max_chunk_bytes { self.flush() } else { Ok(()) }
    }

    pub fn tick(&mut self, now: Timestamp) -> Result<(), BagError> {
        if self.chunk.first_log_ns.is_none() {
            return Ok(());
        }
        let since = *self.chunk.first_tick.get_or_insert(now);
        if now.0.saturating_sub(since.0)
            >= i64::try_from(self.options.max_chunk_age.as_nanos()).unwrap_or(i64::MAX)
        {
            return self.flush();
        }
        Ok(())
    }

    pub fn flush(&mut self) -> Result<(), BagError> {
        let Some(mcap) = self.mcap.as_mut() else {
            return Err(BagError::Stopped { path: self.path.clone() });
        };
        self.chunk = Chunk::default();
        let result = mcap.flush();
        self.note(result)
    }

    /// Writes index and footer.
    pub fn close(&mut self) -> Result<(), BagError> {
        let Some(mut mcap) = self.mcap.take() else {
            return Err(BagError::Stopped { path: self.path.clone() });
        };
        let result = mcap.finish().map(drop);
        self.note(result)
    }

    /// Classifies the result of a write; whatever fails there stops the recording.
    fn note(&mut self, result: mcap::McapResult<()>) -> Result<(), BagError> {
        let Err(error) = result else { return Ok(()) };
        self.stopped = true;
        Err(match error {
            mcap::McapError::Io(source) if is_disk_full(&source) => {
                BagError::DiskFull { path: self.path.clone(), bytes_kept: self.bytes_written() }
            }
            mcap::McapError::Io(source) => BagError::io("cannot write", &self.path, source),
            source => BagError::Mcap { path: self.path.clone(), source },
        })
    }

    pub fn bytes_written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    fn described(&self) -> BagFile {
        BagFile {
            name: self.path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            bounds_ns: self.bounds,
            message_count: self.count,
        }
    }
}
