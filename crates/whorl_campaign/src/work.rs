//! The folder of a campaign, its rows, and the work on them.
//!
//! A task is done when its row exists: `rows/<number>.csv` (or `.json`), which appears whole or not at all. So a task may be
//! interrupted and repeated at any point, and whoever computes it writes the same row. Who computes what is the engine's
//! matter: threads here, tasks of a cluster elsewhere. One process directs a folder at a time ([`Folder::hold`]).
//!
//! A folder may be in object storage (`s3://bucket/prefix`): then workers share nothing else.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::iter::{ParallelBridge, ParallelIterator};

use crate::part::Part;
use crate::remote::Remote;

/// File that describes the campaign of a folder.
const DESCRIPTION: &str = "campaign.txt";

/// A list of independent, deterministic tasks, each with one row.
pub trait Tasks: Sync {
    /// How many.
    fn len(&self) -> u64;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Ending of the files of rows.
    fn ending(&self) -> &'static str;

    /// Computes a task: the text of its row. What fails about the task itself stands in the row; files beside it go into
    /// the folder, and are replaced where an interrupted worker left some.
    ///
    /// # Errors
    /// The file system's: the task has no row then.
    fn compute(&self, folder: &Folder, index: u64) -> io::Result<String>;
}

/// A campaign's folder.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
    ending: &'static str,
    /// Where the campaign is, where that is in object storage; `path` is this process's own then.
    remote: Option<Arc<Remote>>,
}

/// Held by the one process that directs the work on a folder; the system lets go of it when that process ends, however it
/// ends.
#[derive(Debug)]
pub struct Hold {
    /// Locked while it is open; `None` where the file system has no locks.
    _file: Option<File>,
}

impl Folder {
    /// Creates the folder, or opens it to go on. `text` describes the campaign; one that differs from the folder's is refused.
    ///
    /// # Errors
    /// The file system's, or a folder that holds another campaign.
    pub fn open(path: &Path, text: &str, ending: &'static str) -> io::Result<Self> {
        let folder = if whorl_objects::is_remote(path) {
            let remote = Remote::open(path, ending)?;
            Self { path: remote.own().to_owned(), ending, remote: Some(Arc::new(remote)) }
        } else {
            fs::create_dir_all(path.join("rows"))?;
            Self { path: path.to_owned(), ending, remote: None }
        };
        if folder.text(DESCRIPTION)?.is_none() {
            // Tasks of one campaign begin at the same time.
            folder.store_text_once(DESCRIPTION, text)?;
        }
        if folder.text(DESCRIPTION)?.as_deref() != Some(text) {
            return Err(io::Error::other(format!(
                "{} holds another campaign, or its parameters or the version of Whorl have changed since it began; use another folder",
                path.display()
            )));
        }
        Ok(folder)
    }

    /// Where files of the campaign are written. Of a folder in object storage, a folder of this process, whose files
    /// [`Self::publish`] sends.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What a file below [`Self::path`] is called outside of this process.
    #[must_use]
    pub fn told(&self, path: &Path) -> PathBuf {
        match (&self.remote, path.strip_prefix(&self.path)) {
            (Some(remote), Ok(below)) => Path::new(remote.address()).join(below),
            _ => path.to_owned(),
        }
    }

    /// Sends what was written below [`Self::path`] to where the campaign is.
    ///
    /// # Errors
    /// The server's.
    pub fn publish(&self) -> io::Result<()> {
        self.remote.as_ref().map_or(Ok(()), |remote| remote.publish(&self.path))
    }

    /// Whether there are files in a folder of the campaign, whoever wrote them.
    ///
    /// # Errors
    /// The server's.
    pub fn has_files_in(&self, name: &str) -> io::Result<bool> {
        match &self.remote {
            Some(remote) => remote.has_files_in(name),
            None => Ok(self.path.join(name).is_dir()),
        }
    }

    /// The text of a file of the campaign; `None` where there is none.
    ///
    /// # Errors
    /// The file system's, or the server's.
    pub fn text(&self, name: &str) -> io::Result<Option<String>> {
        match &self.remote {
            Some(remote) => remote.text(name),
            None => found(fs::read_to_string(self.path.join(name))),
        }
    }

    /// Writes a file of the campaign, whole or not at all, in place of what was there.
    ///
    /// # Errors
    /// The file system's, or the server's.
    pub(crate) fn store_text(&self, name: &str, text: &str) -> io::Result<()> {
        match &self.remote {
            Some(remote) => remote.store(name, text),
            None => store_whole(&self.path.join(name), text),
        }
    }

    /// The same, unless there is one.
    ///
    /// # Errors
    /// The file system's, or the server's.
    pub(crate) fn store_text_once(&self, name: &str, text: &str) -> io::Result<()> {
        match &self.remote {
            Some(remote) => remote.store_once(name, text),
            None => store_whole_once(&self.path.join(name), text),
        }
    }

    /// Takes charge of the folder: two commands on one folder would compute everything twice. Tasks that an engine
    /// distributes do not take it. Object storage has no locks: there, two commands compute the same rows twice.
    ///
    /// # Errors
    /// When another process has it; the file system's.
    pub fn hold(&self) -> io::Result<Hold> {
        if self.remote.is_some() {
            return Ok(Hold { _file: None });
        }
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
        format!("rows/{index:08}.{}", self.ending)
    }

    /// Directory of a run that is kept.
    #[must_use]
    pub fn run_path(&self, index: u64) -> PathBuf {
        self.path.join("runs").join(format!("{index:08}"))
    }

    /// Whether a task has its row.
    #[must_use]
    pub fn has(&self, index: u64) -> bool {
        match &self.remote {
            Some(remote) => remote.has(index),
            None => self.path.join(self.row_name(index)).exists(),
        }
    }

    /// Stores a row, whole or not at all.
    ///
    /// # Errors
    /// The file system's.
    pub fn store(&self, index: u64, row: &str) -> io::Result<()> {
        self.store_text(&self.row_name(index), row)?;
        if let Some(remote) = &self.remote {
            remote.add(index);
        }
        Ok(())
    }

    /// The row of a task, if it is done.
    ///
    /// # Errors
    /// The file system's.
    pub fn row(&self, index: u64) -> io::Result<Option<String>> {
        self.text(&self.row_name(index))
    }

    /// Rows of so many tasks, in their order.
    fn texts(&self, len: u64) -> io::Result<Vec<Option<String>>> {
        match &self.remote {
            Some(remote) => remote.texts(&(0..len).map(|index| self.row_name(index)).collect::<Vec<_>>()),
            None => (0..len).map(|index| self.row(index)).collect(),
        }
    }

    /// Rows of so many tasks, in their order, each read by `parse`; of tasks that are not done there are none.
    ///
    /// # Errors
    /// The file system's, or a row that cannot be read, with its file.
    pub fn rows<T, E: std::fmt::Display>(
        &self,
        len: u64,
        parse: impl Fn(u64, &str) -> Result<T, E>,
    ) -> io::Result<Vec<T>> {
        let mut rows = Vec::new();
        for (index, text) in (0..).zip(self.texts(len)?) {
            let Some(text) = text else { continue };
            let row = parse(index, &text).map_err(|why| {
                let path = self.told(&self.path.join(self.row_name(index)));
                io::Error::other(format!("{}: {why}; without the file, it is computed again", path.display()))
            })?;
            rows.push(row);
        }
        Ok(rows)
    }

    /// Number of finished rows.
    ///
    /// # Errors
    /// The file system's.
    pub fn done(&self) -> io::Result<u64> {
        if let Some(remote) = &self.remote {
            return remote.done();
        }
        let rows = fs::read_dir(self.path.join("rows"))?;
        Ok(rows.flatten().filter(|e| e.path().extension().is_some_and(|x| x == self.ending)).count() as u64)
    }
}

/// Writes a file whole or not at all, in place of what was there.
///
/// # Errors
/// The file system's.
pub(crate) fn store_whole(path: &Path, text: &str) -> io::Result<()> {
    let unfinished = path.with_extension(unique());
    fs::write(&unfinished, text)?;
    fs::rename(&unfinished, path)
}

/// Writes a file whole or not at all, unless there is one.
///
/// # Errors
/// The file system's.
pub(crate) fn store_whole_once(path: &Path, text: &str) -> io::Result<()> {
    let unfinished = path.with_extension(unique());
    fs::write(&unfinished, text)?;
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

/// Computes the tasks of a part that have no row yet, on so many threads; `progress` counts them. Nobody else may work on
/// this part at the same time, which is what the engine sees to.
///
/// # Errors
/// The file system's, of any thread: no further task is begun.
pub fn work<T: Tasks + ?Sized>(
    folder: &Folder,
    tasks: &T,
    part: Part,
    threads: usize,
    progress: &AtomicU64,
) -> io::Result<()> {
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build().map_err(io::Error::other)?;
    let one = |index: u64| -> io::Result<()> {
        run(folder, tasks, index)?;
        progress.fetch_add(1, Ordering::Relaxed);
        Ok(())
    };
    // A bridge hands the tasks out one by one, in their order.
    pool.install(|| part.runs(tasks.len()).filter(|index| !folder.has(*index)).par_bridge().try_for_each(one))
}

/// Computes a task and stores its row: the same whoever computes it and however often.
///
/// # Errors
/// As [`Tasks::compute`].
pub fn run<T: Tasks + ?Sized>(folder: &Folder, tasks: &T, index: u64) -> io::Result<()> {
    let Some(remote) = &folder.remote else { return folder.store(index, &tasks.compute(folder, index)?) };
    // Its files in a folder of its own, which are there before its row says so.
    let own = tempfile::tempdir_in(&folder.path)?;
    let folder_of_task =
        Folder { path: own.path().to_owned(), ending: folder.ending, remote: Some(Arc::clone(remote)) };
    let row = tasks.compute(&folder_of_task, index)?;
    remote.publish(own.path())?;
    folder.store(index, &row)
}
