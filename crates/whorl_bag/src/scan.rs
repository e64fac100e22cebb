//! The table of contents of one MCAP file: from its summary, or, when that is missing because the writer
//! was killed, by reading the file from the start up to the last whole record.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use mcap::records::{self, ChunkHeader, ChunkIndex, Record, op};
use mcap::sans_io::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use mcap::{Channel, McapError, McapResult, Schema, Summary};

use crate::BagError;
use crate::zstandard::{self, ZSTANDARD};

/// No record of a bag is longer than this; a longer one is a damaged length.
pub(crate) const RECORD_LIMIT: usize = 1 << 30;

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
        {
            return Ok(Self {
                counts: stats.channel_message_counts.clone(),
                bounds: (stats.message_count > 0)
                    .then_some((stats.message_start_time, stats.message_end_time)),
                summary,
                loose: Vec::new(),
                integrity: Integrity { complete: true, ..Integrity::default() },
            });
        }
        let mut scan = Scan::default();
        let integrity = scan.file(file, length).map_err(BagError::mcap(path))?;
        Ok(scan.contents(integrity))
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

#[derive(Default)]
struct Scan {
    schemas: HashMap<u16, Arc<Schema<'static>>>,
    channels: HashMap<u16, Arc<Channel<'static>>>,
    chunks: Vec<ChunkIndex>,
    loose: Vec<LooseMessage>,
    counts: BTreeMap<u16, u64>,
    bounds: Option<(u64, u64)>,
}

impl Scan {
    /// Reads whole records until the end of the data section or of the file.
    fn file(&mut self, file: &mut File, length: u64) -> McapResult<Integrity> {
        file.seek(SeekFrom::Start(0))?;
        let mut file = std::io::BufReader::with_capacity(1 << 16, file);
        let mut magic = [0; 8];
        if length < 8 {
            return Err(McapError::UnexpectedEof);
        }
        file.read_exact(&mut magic)?;
        if magic != mcap::MAGIC {
            return Err(McapError::BadMagic);
        }
        let mut position = 8;
        let mut integrity = Integrity::default();
        let mut body = Vec::new();
        while length - position >= 9 {
            let mut head = [0; 9];
            file.read_exact(&mut head)?;
            let [opcode, size @ ..] = head;
            let size = u64::from_le_bytes(size);
            let room = length - position - 9;
            if opcode == op::FOOTER {
                integrity.complete = true;
                position = length;
                break;
            }
            if size > room || size > RECORD_LIMIT as u64 || opcode == 0 {
                break;
            }
            body.resize(size as usize, 0);
            file.read_exact(&mut body)?;
            let result = match opcode {
                op::CHUNK => self.chunk(position, &body),
                op::SCHEMA | op::CHANNEL | op::MESSAGE => mcap::parse_record(opcode, &body)
                    .and_then(|record| self.definition_or_message(&record, Some(position + 9))),
                _ => Ok(()),
            };
            if result.is_err() {
                integrity.damaged_chunks += 1;
            }
            position += 9 + size;
        }
        integrity.bytes_cut_off = length - position;
        Ok(integrity)
    }

    fn chunk(&mut self, position: u64, body: &[u8]) -> McapResult<()> {
        let Record::Chunk { header, data } = mcap::parse_record(op::CHUNK, body)? else {
            return Err(McapError::BadIndex);
        };
        // First all of it, so that a chunk with a wrong checksum adds nothing.
        let decoded;
        let (header_of_data, data) = if header.compression == ZSTANDARD {
            decoded = zstandard::decode(&data, header.uncompressed_size)?;
            let compressed_size = header.uncompressed_size;
            let plain = ChunkHeader { compression: String::new(), compressed_size, ..header.clone() };
            (plain, decoded.as_slice())
        } else {
            (header.clone(), &*data)
        };
        let records = mcap::read::ChunkReader::new(header_of_data, data)?
            .map(|record| record.map(Record::into_owned))
            .collect::<McapResult<Vec<_>>>()?;
        for record in &records {
            self.definition_or_message(record, None)?;
        }
        self.chunks.push(ChunkIndex {
            message_start_time: header.message_start_time,
            message_end_time: header.message_end_time,
            chunk_start_offset: position,
            chunk_length: 9 + body.len() as u64,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: header.compression,
            compressed_size: header.compressed_size,
            uncompressed_size: header.uncompressed_size,
        });
        Ok(())
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
