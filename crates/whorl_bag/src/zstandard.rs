//! Zstandard chunks, which `ros2 bag record` writes by default: reading only, without a C library.

use std::io::Read;

use mcap::sans_io::decompressor::{DecompressResult, Decompressor};
use mcap::{McapError, McapResult};
use ruzstd::decoding::StreamingDecoder;

/// The name of the compression in MCAP.
pub(crate) const ZSTANDARD: &str = "zstd";

/// Decodes a whole chunk.
///
/// # Errors
/// When it is damaged, or does not decode to `length` bytes.
pub(crate) fn decode(chunk: &[u8], length: u64) -> McapResult<Vec<u8>> {
    let wrong = |reason: String| McapError::DecompressionError(format!("zstd: {reason}"));
    let mut source = chunk;
    let mut decoded = Vec::new();
    while (decoded.len() as u64) < length && !source.is_empty() {
        let decoder = StreamingDecoder::new(&mut source).map_err(|e| wrong(e.to_string()))?;
        let room = length - decoded.len() as u64;
        // One byte more than there should be shows a frame that is too long.
        decoder.take(room + 1).read_to_end(&mut decoded)?;
    }
    if decoded.len() as u64 == length {
        Ok(decoded)
    } else {
        Err(wrong(format!("{} bytes decoded, the chunk says {length}", decoded.len())))
    }
}

/// For [`mcap::sans_io::IndexedReader`], which hands over a chunk in one piece.
#[derive(Debug, Default)]
pub(crate) struct Zstandard;

impl Decompressor for Zstandard {
    fn next_read_size(&self) -> usize {
        0
    }

    fn decompress(&mut self, source: &[u8], target: &mut [u8]) -> McapResult<DecompressResult> {
        let decoded = decode(source, target.len() as u64)?;
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
