//! The folder of a campaign, its rows, and the work on them.
//!
//! A task is done when its row exists: `rows/<number>.csv` (or `.json`), which appears whole or not at all. So a task may be
//! interrupted and repeated at any point, and whoever computes it writes the same row. Who computes what is the engine's
//! matter: threads here, tasks of a cluster elsewhere. One process directs a folder at a time ([`Folder::hold`]).
//!
//! A folder may be in object storage (`s3://bucket/prefix`): then workers share nothing else.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::iter::{ParallelBridge, ParallelIterator};

use crate::part::Part;
pub use crate::store::Hold;
use crate::store::{self, Store};

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
    store: Arc<dyn Store>,
}

impl Folder {
    /// Creates the folder, or opens it to go on. `text` describes the campaign; one that differs from the folder's is refused.
    ///
    /// # Errors
    /// The file system's, or a folder that holds another campaign.
    pub fn open(path: &Path, text: &str, ending: &'static str) -> io::Result<Self> {
        let (store, own) = store::open(path, ending)?;
        if store.text(DESCRIPTION)?.is_none() {
            // Tasks of one campaign begin at the same time.
            store.store_once(DESCRIPTION, text)?;
        }
        if store.text(DESCRIPTION)?.as_deref() != Some(text) {
            return Err(io::Error::other(format!(
                "{} holds another campaign, or its parameters or the version of Whorl have changed since it began; use another folder",
                path.display()
            )));
        }
        Ok(Self { path: own, store })
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
        path.strip_prefix(&self.path).map_or_else(|_| path.to_owned(), |name| self.store.address(name))
    }

    /// Sends what was written below [`Self::path`] to where the campaign is.
    ///
    /// # Errors
    /// The server's.
    pub fn publish(&self) -> io::Result<()> {
        self.store.publish(&self.path)
    }

    /// Whether there are files in a folder of the campaign, whoever wrote them.
    ///
    /// # Errors
    /// The server's.
    pub fn has_files_in(&self, name: &str) -> io::Result<bool> {
        self.store.has_files_in(name)
    }

    /// The text of a file of the campaign; `None` where there is none.
    ///
    /// # Errors
    /// The file system's, or the server's.
    pub fn text(&self, name: &str) -> io::Result<Option<String>> {
        self.store.text(name)
    }

    /// Writes a file of the campaign, whole or not at all, in place of what was there.
    ///
    /// # Errors
    /// The file system's, or the server's.
    pub(crate) fn store_text(&self, name: &str, text: &str) -> io::Result<()> {
        self.store.store(name, text)
    }

    /// The same, unless there is one.
    ///
    /// # Errors
    /// The file system's, or the server's.
    pub(crate) fn store_text_once(&self, name: &str, text: &str) -> io::Result<()> {
        self.store.store_once(name, text)
    }

    /// Takes charge of the folder: two commands on one folder would compute everything twice. Tasks that an engine
    /// distributes do not take it. Object storage has no locks: there, two commands compute the same rows twice.
    ///
    /// # Errors
    /// When another process has it; the file system's.
    pub fn hold(&self) -> io::Result<Hold> {
        self.store.hold()
    }

    /// Directory of a run that is kept.
    #[must_use]
    pub fn run_path(&self, index: u64) -> PathBuf {
        self.path.join("runs").join(format!("{index:08}"))
    }

    /// Whether a task has its row.
    #[must_use]
    pub fn has(&self, index: u64) -> bool {
        self.store.has(index)
    }

    /// Stores a row, whole or not at all.
    ///
    /// # Errors
    /// The file system's.
    pub fn store(&self, index: u64, row: &str) -> io::Result<()> {
        self.store.store_row(index, row)
    }

    /// The row of a task, if it is done.
    ///
    /// # Errors
    /// The file system's.
    pub fn row(&self, index: u64) -> io::Result<Option<String>> {
        self.text(&self.store.row_name(index))
    }

    /// Rows of so many tasks, in their order.
    fn texts(&self, len: u64) -> io::Result<Vec<Option<String>>> {
        self.store.texts(&(0..len).map(|index| self.store.row_name(index)).collect::<Vec<_>>())
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
                let path = self.store.address(Path::new(&self.store.row_name(index)));
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
        self.store.done()
    }
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
    let Some(own) = folder.store.room_for_a_task()? else {
        return folder.store(index, &tasks.compute(folder, index)?);
    };
    // Its files are there before its row says so.
    let of_task = Folder { path: own.path().to_owned(), store: Arc::clone(&folder.store) };
    let row = tasks.compute(&of_task, index)?;
    of_task.publish()?;
    folder.store(index, &row)
}
