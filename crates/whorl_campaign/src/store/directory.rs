//! A campaign's folder in a file system.

use std::fs::{self, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use tempfile::TempDir;
use whorl_files::write_file;

use super::{Hold, Store, row_name};

/// The folder itself.
#[derive(Debug)]
pub(crate) struct Directory {
    path: PathBuf,
    ending: &'static str,
}

impl Directory {
    /// Makes the folder, or opens it to go on.
    pub fn open(path: &Path, ending: &'static str) -> io::Result<Self> {
        fs::create_dir_all(path.join("rows"))?;
        Ok(Self { path: path.to_owned(), ending })
    }
}

impl Store for Directory {
    fn text(&self, name: &str) -> io::Result<Option<String>> {
        found(fs::read_to_string(self.path.join(name)))
    }

    fn texts(&self, names: &[String]) -> io::Result<Vec<Option<String>>> {
        names.iter().map(|name| self.text(name)).collect()
    }

    fn store(&self, name: &str, text: &str) -> io::Result<()> {
        store_whole(&self.path.join(name), text)
    }

    fn store_once(&self, name: &str, text: &str) -> io::Result<()> {
        store_whole_once(&self.path.join(name), text)
    }

    fn has_files_in(&self, name: &str) -> io::Result<bool> {
        Ok(self.path.join(name).is_dir())
    }

    fn has(&self, index: u64) -> bool {
        self.path.join(self.row_name(index)).exists()
    }

    fn store_row(&self, index: u64, row: &str) -> io::Result<()> {
        self.store(&self.row_name(index), row)
    }

    fn done(&self) -> io::Result<u64> {
        let rows = fs::read_dir(self.path.join("rows"))?;
        Ok(rows.flatten().filter(|e| e.path().extension().is_some_and(|x| x == self.ending)).count() as u64)
    }

    fn hold(&self) -> io::Result<Hold> {
        let path = self.path.join("lock");
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path)?;
        match file.try_lock() {
            Ok(()) => {
                file.set_len(0)?;
                writeln!(file, "process {} on {}", std::process::id(), host())?;
                Ok(Hold { _file: Some(file) })
            }
            Err(TryLockError::WouldBlock) => {
                let holder = fs::read_to_string(&path).unwrap_or_default();
                let holder = match holder.trim() {
                    "" => "another process",
                    known => known,
                };
                Err(io::Error::other(format!(
                    "{holder} works on this campaign already; wait for it, end it, or use another folder"
                )))
            }
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                Ok(Hold { _file: None })
            }
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    fn row_name(&self, index: u64) -> String {
        row_name(index, self.ending)
    }

    fn address(&self, name: &Path) -> PathBuf {
        self.path.join(name)
    }

    fn publish(&self, _folder: &Path) -> io::Result<()> {
        Ok(())
    }

    fn room_for_a_task(&self) -> io::Result<Option<TempDir>> {
        Ok(None)
    }
}

/// Writes a file whole or not at all, in place of what was there.
fn store_whole(path: &Path, text: &str) -> io::Result<()> {
    write_file(path, text)
}

/// Writes a file whole or not at all, unless there is one.
fn store_whole_once(path: &Path, text: &str) -> io::Result<()> {
    let unfinished = path.with_extension(unique());
    write_file(&unfinished, text)?;
    let linked = fs::hard_link(&unfinished, path);
    fs::remove_file(&unfinished)?;
    linked.or_else(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => Ok(()),
        // A file system without links.
        _ => OpenOptions::new().write(true).create_new(true).open(path)?.write_all(text.as_bytes()),
    })
}

/// The content of a file that may not be there.
fn found(read: io::Result<String>) -> io::Result<Option<String>> {
    match read {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

fn host() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned()
}

/// Ending of a file that no other process writes; nor another thread, as no two write the same file.
fn unique() -> String {
    format!("{}_{}", host(), std::process::id())
}
