//! The table of contents of one MCAP file: from its summary, or, when that is missing because the writer
//! was killed, by reading the file from the start up to the last whole record.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use mcap::read::ChunkReader;
use mcap::records::{self, ChunkHeader, ChunkIndex, Record, op};
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use mcap::{Channel, McapError, McapResult, Schema, Summary};

use crate::BagError;
use crate::compression::decode;

/// Longest chunk, decoded, and longest record that is read whole \[bytes\]: writers of bags begin a new chunk after some megabytes,
/// and a single message of a camera or a lidar has tens.
pub(crate) const RECORD_LIMIT: usize = 128 << 20;
/// The chunks of a file decode to so many times its length at most, and to [`FREE`] in any case: measurements shrink to a tenth, ...
pub(crate) const EXPANSION: u64 = 200;
/// ... and a small file may be as regular as it likes \[bytes\].
pub(crate) const FREE: u64 = 256 << 20;
/// Messages outside chunks that are listed; some hours of a platform with a camera.
const MOST_LOOSE: usize = 20_000_000;

/// How complete a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Integrity {
    /// Whether the file ends as it should, with its index.
    pub complete: bool,
    /// Bytes at the end that belong to no whole record.
    pub bytes_cut_off: u64,
    /// Chunks inside the file whose checksum or content is wrong; they are left out.
    pub damaged_chunks: u64,
}

/// A message outside any chunk (`ros2 bag record --storage-preset-profile fastwrite`).
#[derive(Debug, Clone, Copy)]
pub(crate) struct LooseMessage {
    pub header: records::MessageHeader,
    /// Where its data is in the file.
    pub offset: u64,
    pub length: usize,
}

/// The table of contents.
pub(crate) struct Contents {
    pub summary: Summary,
    pub loose: Vec<LooseMessage>,
    pub counts: BTreeMap<u16, u64>,
    /// First and last log time.
    pub bounds: Option<(u64, u64)>,
    pub integrity: Integrity,
}

impl Contents {
    pub fn read(path: &Path, file: &mut File) -> Result<Self, BagError> {
        let length = file.metadata().map_err(|e| BagError::io("cannot read", path, e))?.len();
        if let Ok(Some(summary)) = read_summary(file, length)
            && let Some(stats) = summary.stats.clone()
            && (stats.message_count == 0 || !summary.chunk_indexes.is_empty())
            && are_apart(&summary.chunk_indexes, length)
        {
            let mut budget = Budget::of(path, length);
            summary.chunk_indexes.iter().try_for_each(|chunk| budget.take(chunk.uncompressed_size))?;
            return Ok(Self {
                counts: stats.channel_message_counts.clone(),
                bounds: (stats.message_count > 0)
                    .then_some((stats.message_start_time, stats.message_end_time)),
                summary,
                loose: Vec::new(),
                integrity: Integrity { complete: true, ..Integrity::default() },
            });
        }
        let mut scan = Scan::new(Budget::of(path, length));
        let integrity = scan.file(path, file, length)?;
        Ok(scan.contents(integrity))
    }
}

/// Whether chunks lie in the file, each for itself: an index that names one chunk many times is no index.
fn are_apart(chunks: &[ChunkIndex], length: u64) -> bool {
    let mut places: Vec<(u64, u64)> = chunks
        .iter()
        .map(|chunk| (chunk.chunk_start_offset, chunk.chunk_start_offset.saturating_add(chunk.chunk_length)))
        .collect();
    places.sort_unstable();
    let follow = places.iter().zip(places.iter().skip(1)).all(|((_, end), (begin, _))| end <= begin);
    let is_held = |chunk: &ChunkIndex| chunk.compressed_size <= chunk.chunk_length;
    follow && places.last().is_none_or(|(_, end)| *end <= length) && chunks.iter().all(is_held)
}

/// What the chunks of a file may decode to.
struct Budget<'a> {
    path: &'a Path,
    left: u64,
    all: u64,
}

impl<'a> Budget<'a> {
    fn of(path: &'a Path, length: u64) -> Self {
        let all = length.saturating_mul(EXPANSION).max(FREE);
        Self { path, left: all, all }
    }

    /// Counts a chunk, before it is decoded.
    fn take(&mut self, decoded: u64) -> Result<(), BagError> {
        if decoded > RECORD_LIMIT as u64 {
            return Err(self.too_large("a chunk", decoded, RECORD_LIMIT as u64));
        }
        match self.left.checked_sub(decoded) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => Err(self.too_large("the content, decoded,", self.all.saturating_add(1), self.all)),
        }
    }

    fn too_large(&self, what: &'static str, bytes: u64, allowed: u64) -> BagError {
        BagError::TooLarge { path: self.path.to_owned(), what, bytes, allowed }
    }
}

fn read_summary(file: &mut File, length: u64) -> McapResult<Option<Summary>> {
    let mut reader = SummaryReader::new_with_options(
        // No record is longer than the file that holds it.
        SummaryReaderOptions::default()
            .with_file_size(length)
            .with_record_length_limit(usize::try_from(length).map_or(RECORD_LIMIT, |l| l.min(RECORD_LIMIT))),
    );
    while let Some(event) = reader.next_event() {
        match event? {
            SummaryReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted))?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(target) => {
                let position = file.seek(target)?;
                reader.notify_seeked(position);
            }
        }
    }
    Ok(reader.finish())
}

struct Scan<'a> {
    budget: Budget<'a>,
    schemas: HashMap<u16, Arc<Schema<'static>>>,
    channels: HashMap<u16, Arc<Channel<'static>>>,
    chunks: Vec<ChunkIndex>,
    loose: Vec<LooseMessage>,
    counts: BTreeMap<u16, u64>,
    bounds: Option<(u64, u64)>,
}

impl<'a> Scan<'a> {
    fn new(budget: Budget<'a>) -> Self {
        Self {
            budget,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            chunks: Vec::new(),
            loose: Vec::new(),
            counts: BTreeMap::new(),
            bounds: None,
        }
    }

    /// Reads whole records until the end of the data section or of the file.
    fn file(&mut self, path: &Path, file: &mut File, length: u64) -> Result<Integrity, BagError> {
        let mcap = |error: std::io::Error| BagError::mcap(path)(error.into());
        file.seek(SeekFrom::Start(0)).map_err(mcap)?;
        let mut file = std::io::BufReader::with_capacity(1 << 16, file);
        let mut magic = [0; 8];
        if length < 8 {
            return Err(BagError::mcap(path)(McapError::UnexpectedEof));
        }
        file.read_exact(&mut magic).map_err(mcap)?;
        if magic != ::mcap::MAGIC {
            return Err(BagError::mcap(path)(McapError::BadMagic));
        }
        let mut position = 8;
        let mut integrity = Integrity::default();
        let mut body = Vec::new();
        while length - position >= 9 {
            let mut head = [0; 9];
            file.read_exact(&mut head).map_err(mcap)?;
            let [opcode, size @ ..] = head;
            let size = u64::from_le_bytes(size);
            let room = length - position - 9;
            if opcode == op::FOOTER {
                integrity.complete = true;
                position = length;
                break;
            }
            if size > room || opcode == 0 {
                break;
            }
            let begin = position + 9;
            position = begin + size;
            if !matches!(opcode, op::CHUNK | op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                file.seek_relative(i64::try_from(size).unwrap_or(i64::MAX)).map_err(mcap)?;
                continue;
            }
            if size > RECORD_LIMIT as u64 {
                return Err(self.budget.too_large("a record", size, RECORD_LIMIT as u64));
            }
            body.resize(size as usize, 0);
            file.read_exact(&mut body).map_err(mcap)?;
            let result = match opcode {
                op::CHUNK => self.chunk(begin - 9, &body)?,
                _ => ::mcap::parse_record(opcode, &body)
                    .and_then(|record| self.definition_or_message(&record, Some(begin))),
            };
            if result.is_err() {
                integrity.damaged_chunks += 1;
            }
            if self.loose.len() > MOST_LOOSE {
                return Err(BagError::TooManyMessages { path: path.to_owned(), allowed: MOST_LOOSE });
            }
        }
        integrity.bytes_cut_off = length - position;
        Ok(integrity)
    }

    /// Takes the definitions and messages of a chunk. The inner error is one of this chunk alone.
    fn chunk(&mut self, position: u64, body: &[u8]) -> Result<McapResult<()>, BagError> {
        let (header, data) = match ::mcap::parse_record(op::CHUNK, body) {
            Ok(Record::Chunk { header, data }) => (header, data),
            Ok(_) => return Ok(Err(McapError::BadIndex)),
            Err(error) => return Ok(Err(error)),
        };
        self.budget.take(header.uncompressed_size)?;
        let decoded = match decode(&header.compression, &data, header.uncompressed_size) {
            Ok(decoded) => decoded,
            Err(error) => return Ok(Err(error)),
        };
        let taken = self.records(&header, &decoded);
        if let Ok(channels) = &taken {
            self.chunks.push(ChunkIndex {
                message_start_time: header.message_start_time,
                message_end_time: header.message_end_time,
                chunk_start_offset: position,
                chunk_length: 9 + body.len() as u64,
                // Who looks for a topic passes over chunks without it; where its messages stand in the index is not asked.
                message_index_offsets: channels.iter().map(|channel| (*channel, 0)).collect(),
                message_index_length: 0,
                compression: header.compression,
                compressed_size: header.compressed_size,
                uncompressed_size: header.uncompressed_size,
            });
        }
        Ok(taken.map(drop))
    }

    /// Takes the records of a decoded chunk; the channels of its messages.
    fn records(&mut self, header: &ChunkHeader, decoded: &[u8]) -> McapResult<BTreeSet<u16>> {
        let compressed_size = header.uncompressed_size;
        let plain = ChunkHeader { compression: String::new(), compressed_size, ..header.clone() };
        // First all of it, so that a chunk with a wrong checksum adds nothing. One after the other: kept, many small messages take
        // many times their length.
        for record in ChunkReader::new(plain.clone(), decoded)? {
            record?;
        }
        let mut channels = BTreeSet::new();
        for record in ChunkReader::new(plain, decoded)? {
            let record = record?;
            self.definition_or_message(&record, None)?;
            if let Record::Message { header, .. } = record {
                channels.insert(header.channel_id);
            }
        }
        Ok(channels)
    }

    /// `body` is where a record outside any chunk has its body in the file.
    fn definition_or_message(&mut self, record: &Record<'_>, body: Option<u64>) -> McapResult<()> {
        match record {
            Record::Schema { header, data } => {
                let schema = Schema {
                    id: header.id,
                    name: header.name.clone(),
                    encoding: header.encoding.clone(),
                    data: data.clone().into_owned().into(),
                };
                self.schemas.insert(header.id, Arc::new(schema));
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned();
                if schema.is_none() && channel.schema_id != 0 {
                    return Err(McapError::UnknownSchema(channel.topic.clone(), channel.schema_id));
                }
                let found = Channel {
                    id: channel.id,
                    topic: channel.topic.clone(),
                    schema,
                    message_encoding: channel.message_encoding.clone(),
                    metadata: channel.metadata.clone(),
                };
                self.channels.insert(channel.id, Arc::new(found));
            }
            Record::Message { header, data } => {
                if !self.channels.contains_key(&header.channel_id) {
                    return Err(McapError::UnknownChannel(header.sequence, header.channel_id));
                }
                if let Some(body) = body {
                    let offset = body + MESSAGE_HEADER_BYTES;
                    self.loose.push(LooseMessage { header: *header, offset, length: data.len() });
                }
                *self.counts.entry(header.channel_id).or_default() += 1;
                self.bounds = Some(match self.bounds {
                    None => (header.log_time, header.log_time),
                    Some((first, last)) => (first.min(header.log_time), last.max(header.log_time)),
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn contents(mut self, integrity: Integrity) -> Contents {
        self.loose.sort_by_key(|message| message.header.log_time);
        Contents {
            summary: Summary {
                channels: self.channels,
                schemas: self.schemas,
                chunk_indexes: self.chunks,
                ..Summary::default()
            },
            loose: self.loose,
            counts: self.counts,
            bounds: self.bounds,
            integrity,
        }
    }
}

/// Channel 2, sequence 4, two times of 8 bytes.
const MESSAGE_HEADER_BYTES: u64 = 22;
