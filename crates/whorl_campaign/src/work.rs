//! Claims and rows: how threads, processes and machines share one campaign folder.
//!
//! A worker takes a run by creating `claims/<run>` (only one can), simulates it, and moves its row to
//! `rows/<run>.csv`. A claim without a row belongs to a running worker or to an interrupted one. On the
//! same machine its process is checked; a claim of another machine counts as abandoned after ten minutes.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use rayon::iter::{ParallelBridge, ParallelIterator};

use crate::part::Part;
use crate::plan::Plan;
use crate::row::Row;
use crate::single::simulate;
use crate::table::{parse_row, row_text};

/// A claim of another machine that is older than this is abandoned.
const LEFT_BEHIND: Duration = Duration::from_secs(600);

/// A campaign's folder.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
    host: String,
}

impl Folder {
    /// Creates the folder, or opens it to resume. `text` describes the campaign; one that differs from the
    /// folder's is refused.
    ///
    /// # Errors
    /// The file system's, or a folder that holds another campaign.
    pub fn open(path: &Path, text: &str) -> io::Result<Self> {
        fs::create_dir_all(path.join("claims"))?;
        fs::create_dir_all(path.join("rows"))?;
        let own = path.join("campaign.txt");
        match OpenOptions::new().write(true).create_new(true).open(&own) {
            Ok(mut file) => file.write_all(text.as_bytes())?,
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                // Another worker may be writing it at this moment.
                let mut held = fs::read_to_string(&own)?;
                for _ in 0..50 {
                    if held == text {
                        break;
                    }
                    std::thread::sleep(Duration::from_millis(20));
                    held = fs::read_to_string(&own)?;
                }
                if held != text {
                    return Err(io::Error::other(format!(
                        "{} holds another campaign, or its parameters have changed since it began; use another folder",
                        path.display()
                    )));
                }
            }
            Err(error) => return Err(error),
        }
        let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned();
        Ok(Self { path: path.to_owned(), host })
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn row_path(&self, index: u64) -> PathBuf {
        self.path.join("rows").join(format!("{index:08}.csv"))
    }

    fn claim_path(&self, index: u64) -> PathBuf {
        self.path.join("claims").join(format!("{index:08}"))
    }

    /// Directory of a run that is kept.
    #[must_use]
    pub fn run_path(&self, index: u64) -> PathBuf {
        self.path.join("runs").join(format!("{index:08}"))
    }

    /// Whether a run has its row.
    #[must_use]
    pub fn has(&self, index: u64) -> bool {
        self.row_path(index).exists()
    }

    /// Claims a run; false if it is done or claimed by another worker.
    ///
    /// # Errors
    /// The file system's.
    pub fn claim(&self, index: u64) -> io::Result<bool> {
        if self.row_path(index).exists() {
            return Ok(false);
        }
        let path = self.claim_path(index);
        let holder = format!("{} {}\n", self.host, std::process::id());
        for _ in 0..2 {
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(mut file) => {
                    file.write_all(holder.as_bytes())?;
                    return Ok(true);
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                    if !self.left_behind(&path) {
                        return Ok(false);
                    }
                    // If several workers find it, one removes it and one creates it again.
                    let _ = fs::remove_file(&path);
                }
                Err(error) => return Err(error),
            }
        }
        Ok(false)
    }

    fn left_behind(&self, claim: &Path) -> bool {
        let Ok(text) = fs::read_to_string(claim) else { return false };
        if let Some((host, process)) = text.trim().split_once(' ')
            && host == self.host
            && process.parse::<u32>().is_ok()
        {
            return !Path::new("/proc").join(process).exists();
        }
        // A claim of another machine, or one that is being written.
        let age = claim
            .metadata()
            .and_then(|m| m.modified())
            .ok()
            .and_then(|t| SystemTime::now().duration_since(t).ok());
        age.is_some_and(|age| age > LEFT_BEHIND)
    }

    /// Stores a row, whole or not at all.
    ///
    /// # Errors
    /// The file system's.
    pub fn store(&self, row: &Row) -> io::Result<()> {
        let path = self.row_path(row.index);
        let unfinished = path.with_extension(format!("{}_{}", self.host, std::process::id()));
        File::create(&unfinished)?.write_all(row_text(row).as_bytes())?;
        fs::rename(&unfinished, path)
    }

    /// Finished rows, in the order of runs.
    ///
    /// # Errors
    /// The file system's, or a row that cannot be read.
    pub fn rows(&self, plan: &Plan) -> io::Result<Vec<Row>> {
        let mut rows = Vec::new();
        for index in 0..plan.len() {
            match fs::read_to_string(self.row_path(index)) {
                Ok(text) => rows.push(parse_row(&text, plan.definition.axes.len())?),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(rows)
    }

    /// Number of finished rows.
    ///
    /// # Errors
    /// The file system's.
    pub fn done(&self) -> io::Result<u64> {
        let rows = fs::read_dir(self.path.join("rows"))?;
        Ok(rows.flatten().filter(|e| e.path().extension().is_some_and(|x| x == "csv")).count() as u64)
    }
}

/// Works until every run is claimed, on so many threads. `progress` counts the runs done here. Each run has its own seed
/// and row, so rows do not depend on who takes which.
///
/// # Errors
/// The file system's, of any thread: no further run is begun.
pub fn work(folder: &Folder, plan: &Plan, threads: usize, progress: &AtomicU64) -> io::Result<()> {
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build().map_err(io::Error::other)?;
    let one = |index: u64| -> io::Result<()> {
        if folder.claim(index)? {
            run(folder, plan, index)?;
            progress.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    };
    // A bridge hands the runs out one by one, in their order.
    pool.install(|| (0..plan.len()).par_bridge().try_for_each(one))
}

/// Computes the runs of a part that have no row yet, on so many threads; `progress` counts them. Nobody else may work on this
/// part at the same time, which is what an engine sees to: there are no claims.
///
/// # Errors
/// As [`work`].
pub fn work_part(
    folder: &Folder,
    plan: &Plan,
    part: Part,
    threads: usize,
    progress: &AtomicU64,
) -> io::Result<()> {
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build().map_err(io::Error::other)?;
    let one = |index: u64| -> io::Result<()> {
        run(folder, plan, index)?;
        progress.fetch_add(1, Ordering::Relaxed);
        Ok(())
    };
    pool.install(|| part.runs(plan.len()).filter(|index| !folder.has(*index)).par_bridge().try_for_each(one))
}

/// Simulates a run and stores its row: the one task of a campaign, the same whoever computes it and however often.
///
/// # Errors
/// The file system's.
pub fn run(folder: &Folder, plan: &Plan, index: u64) -> io::Result<()> {
    let Some(spec) = plan.run(index) else { return Ok(()) };
    let kept = plan.definition.keep_every > 0 && index.is_multiple_of(plan.definition.keep_every);
    let keep = kept.then(|| folder.run_path(index));
    if let Some(begun) = keep.as_deref().filter(|path| path.exists()) {
        // Of a worker that was interrupted: it has no row.
        fs::remove_dir_all(begun)?;
    }
    folder.store(&simulate(&spec, plan.definition.longest_s, keep.as_deref()))
}
