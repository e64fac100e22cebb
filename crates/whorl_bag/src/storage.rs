//! An append-only file that never keeps half a chunk.

use std::fs::{File, TryLockError};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::BagError;

/// What lies below the MCAP writer: a file, or something that fails on demand in tests.
pub(crate) trait Storage: Send {
    /// Writes all bytes at the end.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Cuts back to `length` bytes.
    fn truncate(&mut self, length: u64) -> io::Result<()>;
}

/// A file, locked against [`crate::recover`] while it is being written.
#[derive(Debug)]
pub(crate) struct LockedFile {
    file: File,
}

impl LockedFile {
    pub fn create(path: &Path) -> Result<Self, BagError> {
        let file = File::create_new(path).map_err(|e| match e.kind() {
            io::ErrorKind::AlreadyExists => BagError::Exists { path: path.to_owned() },
            _ => BagError::io("cannot create", path, e),
        })?;
        lock(&file, path)?;
        Ok(Self { file })
    }
}

/// Space set aside at the start, so that a full disk leaves room for the last chunk, the index and the
/// manifest. Given back when dropped.
#[derive(Debug)]
pub(crate) struct Reserve {
    path: PathBuf,
}

impl Reserve {
    /// Its size.
    pub const BYTES: usize = 4 << 20;
    /// Name of the file in the bag's directory.
    pub const FILE: &str = ".reserve";

    /// Without the reserve a full disk costs the index, which can be rebuilt: so failing is not an error.
    pub fn set_aside(directory: &Path) -> Self {
        let path = directory.join(Self::FILE);
        let _ = whorl_files::write_file(&path, vec![0; Self::BYTES]);
        Self { path }
    }
}

impl Drop for Reserve {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Locks a bag file for as long as `file` is open; the lock ends with the process, however it ends.
pub(crate) fn lock(file: &File, path: &Path) -> Result<(), BagError> {
    match file.try_lock() {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(BagError::InUse { path: path.to_owned() }),
        // File systems without locks: there is no protection, and no reason not to record.
        Err(TryLockError::Error(_)) => Ok(()),
    }
}

impl Storage for LockedFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        // A file without a name takes bytes as before, and gives them up when it is closed.
        if self.file.metadata()?.nlink() == 0 {
            return Err(io::Error::other("it was deleted while it was being written"));
        }
        self.file.write_all(bytes)
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.file.set_len(length)?;
        self.file.seek(SeekFrom::Start(length)).map(drop)
    }
}

/// Collects what the MCAP writer writes and hands it to the storage only on [`Write::flush`], which the
/// MCAP writer calls after whole chunks. What does not fit is cut off again and stays in memory.
pub(crate) struct AppendSink<S> {
    storage: S,
    /// Bytes in the storage: whole records only. Shared, because the MCAP writer hides its sink.
    written: Arc<AtomicU64>,
    pending: Vec<u8>,
}

impl<S: Storage> AppendSink<S> {
    pub fn new(storage: S) -> Self {
        Self { storage, written: Arc::default(), pending: Vec::new() }
    }

    /// Bytes that a reader can find in the file now.
    pub fn written(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.written)
    }
}

impl<S: Storage> Write for AppendSink<S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        if let Err(error) = self.storage.append(&self.pending) {
            // If this fails too, the file ends in half a chunk, which readers skip.
            let _ = self.storage.truncate(self.written.load(Ordering::Relaxed));
            return Err(error);
        }
        self.written.fetch_add(self.pending.len() as u64, Ordering::Relaxed);
        self.pending.clear();
        Ok(())
    }
}

impl<S: Storage> Seek for AppendSink<S> {
    fn seek(&mut self, target: SeekFrom) -> io::Result<u64> {
        match target {
            // The only question that the MCAP writer asks when it may not seek.
            SeekFrom::Current(0) => Ok(self.written.load(Ordering::Relaxed) + self.pending.len() as u64),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "recordings are only appended to")),
        }
    }
}
