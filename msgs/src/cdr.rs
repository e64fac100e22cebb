//! CDR, the encoding of messages on DDS and in bags (XCDR version 1).

use byteorder::{BigEndian, LittleEndian};
use serde::{Serialize, de::DeserializeOwned};
use thiserror::Error;

/// The 4 bytes in front of a little-endian CDR payload: representation identifier, options.
pub const LITTLE_ENDIAN_HEADER: [u8; 4] = [0, 1, 0, 0];

/// Types that had no list at their end in earlier versions; recordings from then lack it, and it is empty.
const GROWN: [&str; 1] = ["whorl_msgs/msg/ActuatorCommand"];

/// Why bytes could not be encoded or decoded.
#[derive(Debug, Error)]
pub enum CdrError {
    /// Fewer than the 4 header bytes.
    #[error("{length} bytes are too few for a CDR payload")]
    TooShort {
        /// How many there were.
        length: usize,
    },
    /// Neither plain CDR big-endian (0) nor little-endian (1).
    #[error("representation 0x{identifier:04x} is not plain CDR (0x0000 or 0x0001)")]
    Representation {
        /// The identifier found.
        identifier: u16,
    },
    /// The payload does not fit the type.
    #[error("the bytes are not a {type_name}: {source}")]
    Content {
        /// ROS name of the type.
        type_name: &'static str,
        /// What did not fit.
        source: cdr_encoding::Error,
    },
}

/// Encodes with the 4-byte header, little-endian.
///
/// # Errors
/// [`CdrError::Content`] when a length exceeds 32 bits.
pub fn encode<T: Serialize>(type_name: &'static str, value: &T) -> Result<Vec<u8>, CdrError> {
    let mut bytes = Vec::with_capacity(4 + 2 * std::mem::size_of::<T>());
    encode_into(type_name, value, &mut bytes)?;
    Ok(bytes)
}

/// Like [`encode`], into a buffer that is emptied first and keeps its memory.
///
/// # Errors
/// As [`encode`].
pub fn encode_into<T: Serialize>(
    type_name: &'static str,
    value: &T,
    bytes: &mut Vec<u8>,
) -> Result<(), CdrError> {
    bytes.clear();
    bytes.extend_from_slice(&LITTLE_ENDIAN_HEADER);
    cdr_encoding::to_writer::<T, LittleEndian, _>(bytes, value)
        .map_err(|source| CdrError::Content { type_name, source })
}

/// Decodes bytes that begin with the 4-byte header; either byte order.
///
/// # Errors
/// See [`CdrError`].
pub fn decode<T: DeserializeOwned>(type_name: &'static str, bytes: &[u8]) -> Result<T, CdrError> {
    let [high, low, _, _, payload @ ..] = bytes else {
        return Err(CdrError::TooShort { length: bytes.len() });
    };
    let read = |payload: &[u8]| match u16::from_be_bytes([*high, *low]) {
        0 => Ok(cdr_encoding::from_bytes::<T, BigEndian>(payload)),
        1 => Ok(cdr_encoding::from_bytes::<T, LittleEndian>(payload)),
        identifier => Err(CdrError::Representation { identifier }),
    };
    let mut decoded = read(payload)?;
    if decoded.is_err() && GROWN.contains(&type_name) {
        // Its last list starts where the payload ends, at a multiple of 4: an empty one is four zeros.
        let mut longer = payload.to_vec();
        longer.resize(payload.len().next_multiple_of(4) + 4, 0);
        if let Ok(whole) = read(&longer)? {
            decoded = Ok(whole);
        }
    }
    decoded.map(|(value, _)| value).map_err(|source| CdrError::Content { type_name, source })
}
