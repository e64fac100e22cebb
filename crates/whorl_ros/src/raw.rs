//! Readers and writers of raw CDR: what travels on a topic, as bytes.

use std::time::Duration;

use mio::{Interest, Registry, Token, event::Source};
use ros2_client::dds::rustdds::{
    DataWriterStatus, GUID, RTPSEntity, RepresentationIdentifier, StatusEvented, Timestamp as DdsTimestamp,
    WriteOptionsBuilder,
    bytes::Bytes,
    no_key::{DataWriter, Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter, SimpleDataReader},
    rpc::SampleIdentity,
};
use whorl_msgs::cdr::LITTLE_ENDIAN_HEADER;
use whorl_node::Timestamp;

use crate::error::RosError;
use crate::worker::Kept;

/// No message of Whorl is larger than some kilobytes \[bytes\]. Kept and recorded, fifty a second of eight megabytes take all memory.
const LARGEST_SAMPLE: usize = 1 << 20;

/// Identifies a writer or reader on the network: 12 bytes of the participant, 4 of the endpoint.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EndpointId(pub [u8; 16]);

impl EndpointId {
    /// The participant (in Whorl: the process, until it renews its endpoints) it belongs to.
    #[must_use]
    pub fn participant(&self) -> [u8; 12] {
        let mut prefix = [0; 12];
        prefix.copy_from_slice(&self.0[..12]);
        prefix
    }

    pub(crate) fn guid(self) -> GUID {
        GUID::from_bytes(self.0)
    }
}

impl From<GUID> for EndpointId {
    fn from(guid: GUID) -> Self {
        Self(guid.to_bytes())
    }
}

impl std::fmt::Debug for EndpointId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl std::fmt::Display for EndpointId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{self:?}")
    }
}

/// One message as received.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawSample {
    /// CDR with its 4-byte header, as [`whorl_msgs::Message::decode`] takes it and bags store it.
    pub bytes: Vec<u8>,
    /// Its writer.
    pub writer: EndpointId,
    /// The writer's count of its messages, from 1: a gap is a message lost on the way.
    pub sequence_number: i64,
    /// When it was written, by the writer's clock; `None` if it did not say.
    pub source_time: Option<Timestamp>,
    /// When it arrived here, by this machine's clock.
    pub receive_time: Timestamp,
    pub(crate) related: Option<SampleIdentity>,
}

/// CDR payloads, header included.
pub(crate) struct RawCdr;

#[derive(Clone)]
pub(crate) struct KeepBytes;

impl Decode<'_, Vec<u8>> for KeepBytes {
    type Error = std::convert::Infallible;

    fn decode_bytes(self, input: &[u8], encoding: RepresentationIdentifier) -> Result<Vec<u8>, Self::Error> {
        let mut bytes = Vec::with_capacity(4 + input.len());
        let little_endian = encoding == RepresentationIdentifier::CDR_LE;
        bytes.extend_from_slice(&[0, u8::from(little_endian), 0, 0]);
        bytes.extend_from_slice(input);
        Ok(bytes)
    }
}

impl DeserializerAdapter<Vec<u8>> for RawCdr {
    type Error = std::convert::Infallible;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: Vec<u8>) -> Vec<u8> {
        decoded
    }
}

impl DefaultDecoder<Vec<u8>> for RawCdr {
    type Decoder = KeepBytes;
    const DECODER: KeepBytes = KeepBytes;
}

impl SerializerAdapter<Bytes> for RawCdr {
    type Error = std::convert::Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(payload: &Bytes) -> Result<Bytes, Self::Error> {
        Ok(payload.clone())
    }
}

/// Reads raw CDR from one topic. Register it with a [`mio::Poll`], then take until `None`.
pub struct RawReader {
    reader: Kept<SimpleDataReader<Vec<u8>, RawCdr>>,
    topic: String,
}

impl RawReader {
    pub(crate) fn new(reader: Kept<SimpleDataReader<Vec<u8>, RawCdr>>, topic: String) -> Self {
        Self { reader, topic }
    }

    /// The next message, or `None` when there is none now.
    ///
    /// # Errors
    /// When a sample is not plain CDR, or larger than any of Whorl's, or DDS fails. The sample is then skipped.
    pub fn take(&self) -> Result<Option<RawSample>, RosError> {
        let change = match self.reader.try_take_one() {
            Ok(None) => return Ok(None),
            Ok(Some(change)) => change,
            Err(error) => return Err(RosError::dds(format!("reading {}", self.topic), error)),
        };
        let sample = RawSample {
            writer: change.writer_guid().into(),
            sequence_number: i64::from(change.sequence_number),
            source_time: change.source_timestamp().map(timestamp),
            receive_time: timestamp(change.receive_instant),
            related: change.related_sample_identity(),
            bytes: change.into_value(),
        };
        if sample.bytes.len() > LARGEST_SAMPLE {
            return Err(RosError::TooLarge {
                topic: self.topic.clone(),
                bytes: sample.bytes.len(),
                allowed: LARGEST_SAMPLE,
            });
        }
        Ok(Some(sample))
    }

    /// Clears past wake-ups; call it before taking samples, or new wake-ups may be missed.
    pub fn drain_notifications(&self) {
        self.reader.drain_read_notifications();
    }

    /// Who we are on the network.
    #[must_use]
    pub fn id(&self) -> EndpointId {
        self.reader.guid().into()
    }

    /// DDS name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }
}

impl Source for RawReader {
    fn register(&mut self, registry: &Registry, token: Token, interests: Interest) -> std::io::Result<()> {
        self.reader.register(registry, token, interests)
    }

    fn reregister(&mut self, registry: &Registry, token: Token, interests: Interest) -> std::io::Result<()> {
        self.reader.reregister(registry, token, interests)
    }

    fn deregister(&mut self, registry: &Registry) -> std::io::Result<()> {
        self.reader.deregister(registry)
    }
}

/// Writes raw CDR to one topic.
pub struct RawWriter {
    writer: Kept<DataWriter<Bytes, RawCdr>>,
    topic: String,
    is_encrypted: bool,
}

/// RustDDS 0.15 decrypts a payload only if its length is a multiple of this; what is appended, no decoder reads (RTPS
/// itself allows padding after the data, 9.4.2.12).
const ENCRYPTED_ALIGNMENT: usize = 4;

impl RawWriter {
    pub(crate) fn new(writer: Kept<DataWriter<Bytes, RawCdr>>, topic: String, is_encrypted: bool) -> Self {
        Self { writer, topic, is_encrypted }
    }

    /// Sends one message: little-endian CDR with its 4-byte header.
    ///
    /// # Errors
    /// When the bytes do not begin with a little-endian CDR header, or DDS fails.
    pub fn publish(&self, bytes: &[u8]) -> Result<(), RosError> {
        self.write(bytes, None).map(|_| ())
    }

    pub(crate) fn write(
        &self,
        bytes: &[u8],
        related: Option<SampleIdentity>,
    ) -> Result<SampleIdentity, RosError> {
        let Some(payload) = bytes.strip_prefix(&LITTLE_ENDIAN_HEADER) else {
            return Err(RosError::NotLittleEndianCdr { topic: self.topic.clone() });
        };
        let options = WriteOptionsBuilder::new()
            .source_timestamp(DdsTimestamp::now())
            .related_sample_identity_opt(related)
            .build();
        let payload = if self.is_encrypted && !payload.len().is_multiple_of(ENCRYPTED_ALIGNMENT) {
            let mut padded = payload.to_vec();
            padded.resize(payload.len().next_multiple_of(ENCRYPTED_ALIGNMENT), 0);
            padded.into()
        } else {
            Bytes::copy_from_slice(payload)
        };
        self.writer
            .write_with_options(payload, options)
            .map_err(|error| RosError::dds(format!("writing {}", self.topic), error))
    }

    /// Whether a reader was matched since the last call: what is written from then on reaches it.
    pub(crate) fn has_new_reader(&self) -> bool {
        std::iter::from_fn(|| self.writer.try_recv_status())
            .filter(|status| matches!(status, DataWriterStatus::PublicationMatched { .. }))
            .count()
            > 0
    }

    /// Waits until every reliable reader has what was written, at most `timeout`; false if it ran
    /// out. Best-effort readers do not acknowledge.
    #[must_use]
    pub fn flush(&self, timeout: Duration) -> bool {
        self.writer.wait_for_acknowledgments(timeout).unwrap_or(false)
    }

    /// Who we are on the network.
    #[must_use]
    pub fn id(&self) -> EndpointId {
        self.writer.guid().into()
    }

    /// DDS name of the topic.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }
}

/// RTPS time is seconds and 2^-32 fractions since 1970 (RTPS 2.5, 9.3.2.1).
fn timestamp(dds: DdsTimestamp) -> Timestamp {
    let ticks = dds.to_ticks();
    let nanoseconds = ((ticks & 0xffff_ffff) * 1_000_000_000 + (1 << 31)) >> 32;
    Timestamp((ticks >> 32) as i64 * 1_000_000_000 + nanoseconds as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dds_time_becomes_ros_time() {
        assert_eq!(timestamp(DdsTimestamp::from_ticks(5 << 32)), Timestamp(5_000_000_000));
        assert_eq!(timestamp(DdsTimestamp::from_ticks((5 << 32) | (1 << 31))), Timestamp(5_500_000_000));
        assert_eq!(timestamp(DdsTimestamp::from_ticks(0xffff_ffff)), Timestamp(1_000_000_000));
    }

    #[test]
    fn the_header_tells_the_byte_order() {
        let little = KeepBytes.decode_bytes(&[7], RepresentationIdentifier::CDR_LE).unwrap();
        let big = KeepBytes.decode_bytes(&[7], RepresentationIdentifier::CDR_BE).unwrap();
        assert_eq!((little, big), (vec![0, 1, 0, 0, 7], vec![0, 0, 0, 0, 7]));
    }
}
