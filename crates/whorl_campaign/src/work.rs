//! The folder of a campaign, its rows, and the work on them.
//!
//! A task is done when its row exists: `rows/<number>.csv` (or `.json`), which appears whole or not at all. So a task may be
//! interrupted and repeated at any point, and whoever computes it writes the same row. Who computes what is the engine's
//! matter: threads here, tasks of a cluster elsewhere. One process directs a folder at a time ([`Folder::hold`]).

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::iter::{ParallelBridge, ParallelIterator};

use crate::part::Part;

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
        fs::create_dir_all(path.join("rows"))?;
        let own = path.join("campaign.txt");
        if !own.exists() {
            // Tasks of one campaign begin at the same time.
            store_whole_once(&own, text)?;
        }
        if fs::read_to_string(&own)? != text {
            return Err(io::Error::other(format!(
                "{} holds another campaign, or its parameters or the version of Whorl have changed since it began; use another folder",
                path.display()
            )));
        }
        Ok(Self { path: path.to_owned(), ending })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Takes charge of the folder: two commands on one folder would compute everything twice. Tasks that an engine
    /// distributes do not take it.
    ///
    /// # Errors
    /// When another process has it; the file system's.
    pub fn hold(&self) -> io::Result<Hold> {
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

    fn row_path(&self, index: u64) -> PathBuf {
        self.path.join("rows").join(format!("{index:08}.{}", self.ending))
    }

    /// Directory of a run that is kept.
    #[must_use]
    pub fn run_path(&self, index: u64) -> PathBuf {
        self.path.join("runs").join(format!("{index:08}"))
    }

    /// Whether a task has its row.
    #[must_use]
    pub fn has(&self, index: u64) -> bool {
        self.row_path(index).exists()
    }

    /// Stores a row, whole or not at all.
    ///
    /// # Errors
    /// The file system's.
    pub fn store(&self, index: u64, row: &str) -> io::Result<()> {
        store_whole(&self.row_path(index), row)
    }

    /// The row of a task, if it is done.
    ///
    /// # Errors
    /// The file system's.
    pub fn row(&self, index: u64) -> io::Result<Option<String>> {
        match fs::read_to_string(self.row_path(index)) {
            Ok(text) => Ok(Some(text)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Rows of so many tasks, in their order, each read by `parse`; of tasks that are not done there are none.
    ///
    /// # Errors
    /// The file system's, or a row that cannot be read, with its file.
    pub fn rows<T, E: std::fmt::Display>(
        &self,
        len: u64,
        parse: impl Fn(&str) -> Result<T, E>,
    ) -> io::Result<Vec<T>> {
        let mut rows = Vec::new();
        for index in 0..len {
            let Some(text) = self.row(index)? else { continue };
            let row = parse(&text).map_err(|why| {
                let path = self.row_path(index);
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
    folder.store(index, &tasks.compute(folder, index)?)
}
