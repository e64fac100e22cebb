//! Where rows and tables of a campaign are kept: a directory, or object storage.

mod directory;
mod remote;

use std::fmt::Debug;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::TempDir;

pub(crate) use directory::Directory;
pub(crate) use remote::Remote;

/// Held by the one process that directs the work on a folder; the system lets go of it when that process ends, however it
/// ends.
#[derive(Debug)]
pub struct Hold {
    /// Locked while it is open; `None` where the store has no locks.
    _file: Option<File>,
}

/// Files of a campaign by their names below its folder. Whatever one worker stores, all others see, whole or not at all.
pub(crate) trait Store: Debug + Send + Sync {
    /// The text of a file; `None` where there is none.
    fn text(&self, name: &str) -> io::Result<Option<String>>;

    /// Texts of files, in their order.
    fn texts(&self, names: &[String]) -> io::Result<Vec<Option<String>>>;

    /// Writes a file in place of what was there.
    fn store(&self, name: &str, text: &str) -> io::Result<()>;

    /// The same, unless there is one.
    fn store_once(&self, name: &str, text: &str) -> io::Result<()>;

    /// Whether there are files in a folder, whoever wrote them.
    fn has_files_in(&self, name: &str) -> io::Result<bool>;

    /// Whether a task has its row, as far as this process knows.
    fn has(&self, index: u64) -> bool;

    /// Stores the row of a task.
    fn store_row(&self, index: u64, row: &str) -> io::Result<()>;

    /// Number of rows that there are now.
    fn done(&self) -> io::Result<u64>;

    /// Takes charge of the campaign.
    fn hold(&self) -> io::Result<Hold>;

    /// Name of a row's file.
    fn row_name(&self, index: u64) -> String;

    /// What a file of this name is called outside of this process.
    fn address(&self, name: &Path) -> PathBuf;

    /// Sends what was written below a folder of this process to where the campaign is, if that is elsewhere.
    fn publish(&self, folder: &Path) -> io::Result<()>;

    /// A folder for the files of one task, if they are sent where the campaign is once it is done.
    fn room_for_a_task(&self) -> io::Result<Option<TempDir>>;
}

/// The store of a path, and where this process writes its files.
pub(crate) fn open(path: &Path, ending: &'static str) -> io::Result<(Arc<dyn Store>, PathBuf)> {
    if whorl_objects::is_remote(path) {
        let remote = Remote::open(path, ending)?;
        let own = remote.own().to_owned();
        Ok((Arc::new(remote), own))
    } else {
        Ok((Arc::new(Directory::open(path, ending)?), path.to_owned()))
    }
}

/// Name of the file of a row.
fn row_name(index: u64, ending: &str) -> String {
    format!("rows/{index:08}.{ending}")
}
