//! Bags that `ros2 bag record --compression-mode` wrote: whole files in Zstandard, which are unpacked beside everything else and
//! removed again, and messages in Zstandard, each for itself.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::McapError;
use ruzstd::decoding::StreamingDecoder;
use tempfile::TempDir;

use crate::BagError;
use crate::compression::ZSTANDARD;
use crate::scan::{EXPANSION, FREE};

/// What a frame of Zstandard begins with. No CDR message does: its first byte is 0.
const FRAME: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// How names of such files end.
const ENDINGS: [&str; 2] = ["zstd", "zst"];
/// A message decodes to so many bytes beside [`EXPANSION`] times its length at most.
const MESSAGE_FREE: u64 = 1 << 20;

/// Whether a file is compressed as a whole, by its name.
pub(crate) fn is_packed(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ENDINGS.iter().any(|known| ending == *known))
}

/// Whether a path is that of a bag, by its name: a folder, an MCAP file or one of SQLite, compressed or not.
#[must_use]
pub fn is_bag(path: &Path) -> bool {
    let name = if is_packed(path) { path.file_stem().map(Path::new) } else { Some(path) };
    let ending = name.and_then(Path::extension);
    path.is_dir()
        || ending.is_some_and(|ending| ["mcap", "db3"].iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// A file, unpacked if need be, and the folder that is removed with the last of its readers.
pub(crate) fn unpacked(path: &Path) -> Result<(PathBuf, Option<Arc<TempDir>>), BagError> {
    if !is_packed(path) {
        return Ok((path.to_owned(), None));
    }
    let packed = whorl_files::open_file(path).map_err(|e| BagError::io("cannot open", path, e))?;
    let length = packed.metadata().map_err(|e| BagError::io("cannot read", path, e))?.len();
    let folder = tempfile::tempdir().map_err(|e| BagError::io("cannot unpack", path, e))?;
    let whole = folder.path().join(path.file_stem().unwrap_or_default());
    let file = File::create(&whole).map_err(|e| BagError::io("cannot unpack", path, e))?;
    let allowed = length.saturating_mul(EXPANSION).max(FREE);
    unpack(path, packed, file, allowed)?;
    Ok((whole, Some(Arc::new(folder))))
}

fn unpack(path: &Path, packed: File, mut to: File, allowed: u64) -> Result<(), BagError> {
    let failed = |reason: String| BagError::Mcap {
        path: path.to_owned(),
        source: McapError::DecompressionError(format!("{ZSTANDARD}: {reason}")),
    };
    let mut packed = BufReader::new(packed);
    let (mut written, mut buffer) = (0_u64, vec![0; 1 << 20]);
    while !std::io::BufRead::fill_buf(&mut packed)
        .map_err(|e| BagError::io("cannot read", path, e))?
        .is_empty()
    {
        let mut decoder = StreamingDecoder::new(&mut packed).map_err(|e| failed(e.to_string()))?;
        loop {
            let count = decoder.read(&mut buffer).map_err(|e| failed(e.to_string()))?;
            if count == 0 {
                break;
            }
            written += count as u64;
            if written > allowed {
                return Err(BagError::TooLarge {
                    path: path.to_owned(),
                    what: "the content, decoded,",
                    bytes: written,
                    allowed,
                });
            }
            let part = buffer.get(..count).unwrap_or_default();
            to.write_all(part).map_err(|e| BagError::io("cannot unpack", path, e))?;
        }
    }
    Ok(())
}

/// A message as its sender encoded it.
pub(crate) fn message(path: &Path, stored: Vec<u8>) -> Result<Vec<u8>, BagError> {
    if !stored.starts_with(&FRAME) {
        return Ok(stored);
    }
    let failed = |reason: String| BagError::Mcap {
        path: path.to_owned(),
        source: McapError::DecompressionError(format!("a message in {ZSTANDARD}: {reason}")),
    };
    let allowed = (stored.len() as u64).saturating_mul(EXPANSION).saturating_add(MESSAGE_FREE);
    let mut decoded = Vec::new();
    let decoder = StreamingDecoder::new(stored.as_slice()).map_err(|e| failed(e.to_string()))?;
    decoder.take(allowed + 1).read_to_end(&mut decoded).map_err(|e| failed(e.to_string()))?;
    if decoded.len() as u64 > allowed {
        return Err(failed(format!("it decodes to more than {allowed} bytes")));
    }
    Ok(decoded)
}
