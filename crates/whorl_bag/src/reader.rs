//! Reading bags.

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::sans_io::{IndexedReadEvent, IndexedReader, IndexedReaderOptions};
use tempfile::TempDir;
use whorl_math::words::one_line;
use whorl_msgs::Message;
use whorl_node::Timestamp;

use crate::compression::Zstandard;
use crate::metadata::{both, files_and_doubt};
use crate::scan::{Contents, Integrity, LooseMessage, RECORD_LIMIT};
use crate::unpacked::unpacked;
use crate::{BagError, BagFile, BagMetadata, BagTopic};

/// Chunks that overlap in time are held together, up to so many bytes, decoded: recorders write one after the other.
const MOST_AT_ONCE: u64 = 1 << 30;

/// A bag, opened for reading: recorded by Whorl, or by `ros2 bag record` with the mcap storage.
///
/// A file whose writer was killed is read up to its last whole chunk; see [`Self::integrity`].
pub struct BagReader {
    path: PathBuf,
    /// In the order of their first messages.
    files: Vec<(PathBuf, BagFile)>,
    topics: Vec<Arc<BagTopic>>,
    integrity: Integrity,
    doubt: Option<String>,
    /// What was unpacked; removed with the last that reads it.
    unpacked: Vec<Arc<TempDir>>,
}

/// A message as it stands in a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedMessage {
    /// When it was recorded.
    pub log_time: Timestamp,
    /// When its writer sent it.
    pub publish_time: Timestamp,
    /// The writer's sequence number, low 32 bits; 0 if it was not known.
    pub sequence: u32,
    /// Topic and type.
    pub topic: Arc<BagTopic>,
    /// CDR with its 4-byte header.
    pub cdr: Vec<u8>,
}

impl RecordedMessage {
    /// Decodes the message.
    ///
    /// # Errors
    /// [`BagError::UnknownType`]; [`BagError::Decode`] with topic and time.
    pub fn decode(&self) -> Result<Message, BagError> {
        let message_type = self.topic.message_type().ok_or_else(|| BagError::UnknownType {
            topic: self.topic.name.clone(),
            type_name: self.topic.type_name.clone(),
        })?;
        Message::decode(message_type, &self.cdr).map_err(|source| BagError::Decode {
            topic: self.topic.name.clone(),
            log_time_ns: self.log_time.0,
            source,
        })
    }
}

/// Which messages to read. The default is all of them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MessageFilter {
    /// Full names of topics; `None` for all.
    pub topics: Option<Vec<String>>,
    /// First log time.
    pub from: Option<Timestamp>,
    /// First log time that is too late.
    pub until: Option<Timestamp>,
}

impl BagReader {
    /// Opens a bag directory or a single `.mcap` file.
    ///
    /// # Errors
    /// [`BagError::NotFound`], [`BagError::NotABag`], [`BagError::Storage`] for a bag in another storage
    /// format, [`BagError::Metadata`], [`BagError::Mcap`].
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let kind = std::fs::metadata(path).map_err(|e| BagError::io("cannot open", path, e))?;
        let (files, doubt) = if kind.is_dir() {
            files_and_doubt(path)?
        } else if path.file_name().is_some_and(|name| name.to_string_lossy().contains(".db3")) {
            return Err(BagError::Storage { path: path.to_owned(), storage: "sqlite3".into() });
        } else {
            (vec![path.to_owned()], None)
        };
        let mut reader = Self {
            path: path.to_owned(),
            files: Vec::new(),
            topics: Vec::new(),
            integrity: Integrity { complete: true, ..Integrity::default() },
            doubt,
            unpacked: Vec::new(),
        };
        for file in files {
            let (file, folder) = unpacked(&file)?;
            reader.unpacked.extend(folder);
            let described = reader.add_file(&file)?;
            reader.files.push((file, described));
        }
        reader.files.sort_by_key(|(_, file)| file.bounds_ns.map(|(first, _)| first));
        Ok(reader)
    }

    fn add_file(&mut self, path: &Path) -> Result<BagFile, BagError> {
        let contents = open_contents(path)?.1;
        let integrity = contents.integrity;
        self.integrity.complete &= integrity.complete;
        self.integrity.bytes_cut_off += integrity.bytes_cut_off;
        self.integrity.damaged_chunks += integrity.damaged_chunks;
        let mut channels: Vec<_> = contents.summary.channels.values().collect();
        channels.sort_by_key(|channel| channel.id);
        for channel in channels {
            let count = contents.counts.get(&channel.id).copied().unwrap_or(0);
            // Several channels of one topic (writers with different quality of service, or several
            // files) are one topic here.
            match self.topics.iter_mut().find(|topic| topic.name == one_line(&channel.topic)) {
                Some(topic) => {
                    let topic = Arc::make_mut(topic);
                    topic.message_count += count;
                    // One of the writers may have stored the type that another did not know.
                    if topic.type_name.is_empty() {
                        topic.type_name = topic_of(channel, 0).type_name;
                    }
                }
                None => self.topics.push(Arc::new(topic_of(channel, count))),
            }
        }
        Ok(BagFile {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            bounds_ns: contents.bounds,
            message_count: contents.counts.values().sum(),
        })
    }

    /// What `metadata.yaml` should say.
    pub(crate) fn metadata(&self) -> BagMetadata {
        let topics = self.topics.iter().map(|topic| (**topic).clone()).collect();
        BagMetadata::new(topics, self.files.iter().map(|(_, file)| file.clone()).collect())
    }

    /// The path that was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The topics, in the order in which they were first written.
    #[must_use]
    pub fn topics(&self) -> &[Arc<BagTopic>] {
        &self.topics
    }

    /// The topic with this full name.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&BagTopic> {
        self.topics.iter().find(|topic| topic.name == name).map(AsRef::as_ref)
    }

    /// Log times of the first and of the last message; `None` when there is none.
    #[must_use]
    pub fn bounds(&self) -> Option<(Timestamp, Timestamp)> {
        let all = self.files.iter().filter_map(|(_, file)| file.bounds_ns).reduce(both);
        all.map(|(first, last)| (signed(first), signed(last)))
    }

    /// Number of messages.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.message_count).sum()
    }

    /// Bytes of its files.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files
            .iter()
            .filter_map(|(file, _)| std::fs::metadata(file).ok())
            .map(|metadata| metadata.len())
            .sum()
    }

    /// Whether the bag ends as it should, and what is lost if not.
    #[must_use]
    pub fn integrity(&self) -> Integrity {
        self.integrity
    }

    /// Why `metadata.yaml` was not believed, if it was not.
    #[must_use]
    pub fn doubt(&self) -> Option<&str> {
        self.doubt.as_deref()
    }

    /// All messages in the order of their log time.
    #[must_use]
    pub fn messages(&self) -> Messages {
        self.select(MessageFilter::default())
    }

    /// The messages of some topics in the order of their log time. A topic that is not in the bag has none.
    #[must_use]
    pub fn messages_of<S: AsRef<str>>(&self, topics: &[S]) -> Messages {
        let topics = Some(topics.iter().map(|topic| topic.as_ref().to_owned()).collect());
        self.select(MessageFilter { topics, ..MessageFilter::default() })
    }

    /// The messages that pass a filter, in the order of their log time, across the files of a split bag too.
    #[must_use]
    pub fn select(&self, filter: MessageFilter) -> Messages {
        let files =
            self.files.iter().filter_map(|(path, file)| Some((path.clone(), signed(file.bounds_ns?.0))));
        Messages {
            filter,
            topics: self.topics.clone(),
            files: files.collect(),
            open: Vec::new(),
            _unpacked: self.unpacked.clone(),
        }
    }
}

/// Iterates over messages. After an error in a file it goes on with the other ones.
pub struct Messages {
    filter: MessageFilter,
    topics: Vec<Arc<BagTopic>>,
    /// Files that have not been opened yet, with the log time of the first message.
    files: VecDeque<(PathBuf, Timestamp)>,
    open: Vec<FileMessages>,
    _unpacked: Vec<Arc<TempDir>>,
}

impl Iterator for Messages {
    type Item = Result<RecordedMessage, BagError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let next =
                self.open.iter().enumerate().filter_map(|(i, file)| Some((file.next_time()?, i))).min();
            // What arrives while a recorder changes files may stand in either: their ends overlap.
            let begins = |&(_, first): &(PathBuf, Timestamp)| next.is_none_or(|(time, _)| first <= time);
            if self.files.front().is_some_and(begins) {
                let (path, _) = self.files.pop_front()?;
                match FileMessages::open(path, &self.filter, &self.topics) {
                    Ok(messages) => self.open.push(messages),
                    Err(error) => return Some(Err(error)),
                }
                continue;
            }
            let (_, index) = next?;
            let message = self.open.get_mut(index)?.next();
            if !matches!(message, Some(Ok(_))) {
                self.open.remove(index);
            }
            if message.is_some() {
                return message;
            }
        }
    }
}

/// The messages of one file: those in chunks and those outside, merged.
pub(crate) struct FileMessages {
    path: PathBuf,
    file: File,
    topics: HashMap<u16, Arc<BagTopic>>,
    chunked: IndexedReader,
    buffer: Vec<u8>,
    /// Decoded size of each chunk by where its data begins.
    sizes: HashMap<u64, u64>,
    /// Bytes of chunks, decoded, since the last message.
    decoded: u64,
    /// The next message from a chunk, or why there is none.
    head: Option<Result<RecordedMessage, BagError>>,
    loose: VecDeque<LooseMessage>,
}

impl FileMessages {
    pub fn open(path: PathBuf, filter: &MessageFilter, topics: &[Arc<BagTopic>]) -> Result<Self, BagError> {
        let (file, mut contents) = open_contents(&path)?;
        let wanted = |name: &str| filter.topics.as_ref().is_none_or(|list| list.iter().any(|t| t == name));
        let mut written = BTreeSet::new();
        let topics: HashMap<u16, Arc<BagTopic>> = contents
            .summary
            .channels
            .iter()
            .filter_map(|(&id, channel)| {
                let name = one_line(&channel.topic);
                let topic = topics.iter().find(|topic| topic.name == name && wanted(&name))?;
                written.insert(channel.topic.clone());
                Some((id, Arc::clone(topic)))
            })
            .collect();
        let from = filter.from.map_or(0, |t| u64::try_from(t.0).unwrap_or(0));
        let until = filter.until.map_or(u64::MAX, |t| u64::try_from(t.0).unwrap_or(0));
        contents.loose.retain(|message| {
            topics.contains_key(&message.header.channel_id)
                && (from..until).contains(&message.header.log_time)
        });
        if topics.is_empty() || until <= from {
            // To the indexed reader an empty selection means everything.
            contents.summary.chunk_indexes.clear();
        }
        let mut options =
            IndexedReaderOptions::new().include_topics(written).with_record_length_limit(RECORD_LIMIT);
        if from > 0 {
            options = options.starting_at(from);
        }
        if filter.until.is_some() && until > from {
            options = options.ending_before(until);
        }
        let mut chunked =
            IndexedReader::new_with_options(&contents.summary, options).map_err(BagError::mcap(&path))?;
        chunked.add_decompressor(Zstandard).map_err(BagError::mcap(&path))?;
        let mut messages = Self {
            path,
            file,
            topics,
            chunked,
            buffer: Vec::new(),
            sizes: contents.summary.chunk_indexes.iter().filter_map(size_of).collect(),
            decoded: 0,
            head: None,
            loose: contents.loose.into(),
        };
        messages.head = messages.next_chunked().transpose();
        Ok(messages)
    }

    /// Log time of the next message; the earliest of all when it cannot be read, `None` when there is none.
    fn next_time(&self) -> Option<Timestamp> {
        let chunked = match &self.head {
            Some(Ok(message)) => Some(message.log_time),
            Some(Err(_)) if self.loose.is_empty() => Some(Timestamp(i64::MIN)),
            Some(Err(_)) | None => None,
        };
        let loose = self.loose.front().map(|message| signed(message.header.log_time));
        chunked.into_iter().chain(loose).min()
    }

    pub fn next(&mut self) -> Option<Result<RecordedMessage, BagError>> {
        let stored = self.next_stored()?;
        Some(stored.and_then(|message| {
            Ok(RecordedMessage { cdr: crate::unpacked::message(&self.path, message.cdr)?, ..message })
        }))
    }

    fn next_stored(&mut self) -> Option<Result<RecordedMessage, BagError>> {
        let loose_first = match (&self.head, self.loose.front()) {
            (Some(Ok(head)), Some(loose)) => signed(loose.header.log_time) < head.log_time,
            (_, Some(_)) => true,
            (_, None) => false,
        };
        if loose_first {
            let message = self.loose.pop_front()?;
            return Some(self.read_loose(message));
        }
        let head = self.head.take()?;
        if head.is_ok() {
            self.head = self.next_chunked().transpose();
        }
        Some(head)
    }

    fn next_chunked(&mut self) -> Result<Option<RecordedMessage>, BagError> {
        while let Some(event) = self.chunked.next_event() {
            match event.map_err(BagError::mcap(&self.path))? {
                IndexedReadEvent::ReadChunkRequest { offset, length } => {
                    self.decoded += self.sizes.get(&offset).copied().unwrap_or(0);
                    if self.decoded > MOST_AT_ONCE {
                        return Err(BagError::TooLarge {
                            path: self.path.clone(),
                            what: "what has to be sorted by time",
                            bytes: self.decoded,
                            allowed: MOST_AT_ONCE,
                        });
                    }
                    self.buffer.resize(length, 0);
                    self.file
                        .seek(SeekFrom::Start(offset))
                        .and_then(|_| self.file.read_exact(&mut self.buffer))
                        .map_err(|e| BagError::io("cannot read", &self.path, e))?;
                    self.chunked
                        .insert_chunk_record_data(offset, &self.buffer)
                        .map_err(BagError::mcap(&self.path))?;
                }
                IndexedReadEvent::Message { header, data } => {
                    if let Some(topic) = self.topics.get(&header.channel_id) {
                        self.decoded = 0;
                        return Ok(Some(recorded(&header, topic, data.to_vec())));
                    }
                }
            }
        }
        Ok(None)
    }

    fn read_loose(&mut self, message: LooseMessage) -> Result<RecordedMessage, BagError> {
        let mut cdr = vec![0; message.length];
        self.file
            .seek(SeekFrom::Start(message.offset))
            .and_then(|_| self.file.read_exact(&mut cdr))
            .map_err(|e| BagError::io("cannot read", &self.path, e))?;
        match self.topics.get(&message.header.channel_id) {
            Some(topic) => Ok(recorded(&message.header, topic, cdr)),
            // Filtered out when the file was opened.
            None => Err(BagError::UnknownTopic { index: message.header.channel_id.into() }),
        }
    }
}

fn size_of(chunk: &mcap::records::ChunkIndex) -> Option<(u64, u64)> {
    Some((chunk.compressed_data_offset().ok()?, chunk.uncompressed_size))
}

fn recorded(header: &mcap::records::MessageHeader, topic: &Arc<BagTopic>, cdr: Vec<u8>) -> RecordedMessage {
    RecordedMessage {
        log_time: signed(header.log_time),
        publish_time: signed(header.publish_time),
        sequence: header.sequence,
        topic: Arc::clone(topic),
        cdr,
    }
}

pub(crate) fn open_contents(path: &Path) -> Result<(File, Contents), BagError> {
    let mut file = whorl_files::open_file(path).map_err(|e| BagError::io("cannot open", path, e))?;
    let contents = Contents::read(path, &mut file)?;
    Ok((file, contents))
}

pub(crate) fn topic_of(channel: &mcap::Channel<'_>, message_count: u64) -> BagTopic {
    BagTopic {
        // No name in ROS has several lines.
        name: one_line(&channel.topic).into_owned(),
        type_name: channel
            .schema
            .as_ref()
            .map(|schema| one_line(&schema.name).into_owned())
            .unwrap_or_default(),
        encoding: channel.message_encoding.clone(),
        offered_qos_profiles: channel.metadata.get("offered_qos_profiles").cloned().unwrap_or_default(),
        message_count,
    }
}

/// Bags count nanoseconds unsigned; no time after 2262 is meant.
fn signed(time: u64) -> Timestamp {
    Timestamp(i64::try_from(time).unwrap_or(i64::MAX))
}
