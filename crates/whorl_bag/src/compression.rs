//! Compressed chunks: as many bytes as the chunk says, and not one more. Zstandard, which `ros2 bag record` writes by default, without
//! a C library.

use std::borrow::Cow;
use std::io::Read;

use mcap::sans_io::decompressor::{DecompressResult, Decompressor};
use mcap::{McapError, McapResult};
use ruzstd::decoding::StreamingDecoder;

/// The name of the compression in MCAP.
pub(crate) const ZSTANDARD: &str = "zstd";

/// The same.
const LZ4: &str = "lz4";

/// Decodes a whole chunk. Its caller has checked that `length` is not too much.
///
/// # Errors
/// When it is damaged, or does not decode to `length` bytes; another compression.
pub(crate) fn decode<'a>(compression: &str, chunk: &'a [u8], length: u64) -> McapResult<Cow<'a, [u8]>> {
    let mut source = chunk;
    let mut decoded = Vec::new();
    let wrong = |reason: String| McapError::DecompressionError(format!("{compression}: {reason}"));
    match compression {
        "" => return same_length(compression, Cow::Borrowed(chunk), length),
        ZSTANDARD => {
            while (decoded.len() as u64) < length && !source.is_empty() {
                let decoder = StreamingDecoder::new(&mut source).map_err(|e| wrong(e.to_string()))?;
                let room = length - decoded.len() as u64;
                // One byte more than there should be shows a frame that is too long.
                decoder.take(room + 1).read_to_end(&mut decoded)?;
            }
        }
        LZ4 => {
            let decoder = lz4::Decoder::new(source).map_err(|e| wrong(e.to_string()))?;
            decoder.take(length + 1).read_to_end(&mut decoded)?;
        }
        other => return Err(McapError::UnsupportedCompression(other.to_owned())),
    }
    same_length(compression, Cow::Owned(decoded), length)
}

fn same_length<'a>(compression: &str, decoded: Cow<'a, [u8]>, length: u64) -> McapResult<Cow<'a, [u8]>> {
    let found = decoded.len() as u64;
    if found == length {
        return Ok(decoded);
    }
    // What was decoded ends one byte behind the length.
    let found = if found > length { "more".to_owned() } else { format!("{found} bytes") };
    let name = if compression.is_empty() { "not compressed" } else { compression };
    Err(McapError::DecompressionError(format!("{name}: {found} decoded, the chunk says {length} bytes")))
}

/// For [`mcap::sans_io::IndexedReader`], which hands over a chunk in one piece.
#[derive(Debug, Default)]
pub(crate) struct Zstandard;

impl Decompressor for Zstandard {
    fn next_read_size(&self) -> usize {
        0
    }

    fn decompress(&mut self, source: &[u8], target: &mut [u8]) -> McapResult<DecompressResult> {
        let decoded = decode(ZSTANDARD, source, target.len() as u64)?;
        target.copy_from_slice(&decoded);
        Ok(DecompressResult { consumed: source.len(), wrote: decoded.len() })
    }

    fn reset(&mut self) -> McapResult<()> {
        Ok(())
    }

    fn name(&self) -> &'static str {
        ZSTANDARD
    }
}
