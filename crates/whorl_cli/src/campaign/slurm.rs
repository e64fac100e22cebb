//! Follows the array job of a campaign until every run has its row.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use anyhow::bail;
use whorl_campaign::Part;
use whorl_campaign::slurm::{Job, SlurmError, queued};
use whorl_campaign::work::Folder;

use crate::output::{printable, say, tell};

/// Time between two looks at the queue.
const TICK: Duration = Duration::from_secs(2);
/// A controller that is silent for longer is lost.
const PATIENCE: Duration = Duration::from_secs(300);
/// Submissions after which runs that are still missing are given up.
const MOST_SUBMISSIONS: usize = 4;

/// Submits what is missing and waits for it. A job that an earlier call submitted is followed instead.
pub fn distribute(job: &Job, folder: &Folder, total: u64, noun: &str) -> anyhow::Result<()> {
    let mut submissions = 0;
    loop {
        let number = match job.submitted() {
            Some(number) => {
                say!("following job {number}, which was submitted before");
                number
            }
            None => {
                // Where rows are listed, to know of those that others have stored.
                folder.done()?;
                let is_missing = |part: &Part| part.runs(total).any(|index| !folder.has(index));
                let parts: Vec<Part> = Part::all(job.parts).filter(is_missing).collect();
                if parts.is_empty() {
                    return Ok(());
                }
                if submissions == MOST_SUBMISSIONS {
                    bail!(
                        "{} of {total} {noun} are still missing after {submissions} jobs; their logs are in {}",
                        total.saturating_sub(folder.done()?),
                        job.folder.display()
                    );
                }
                submissions += 1;
                let number = job.submit(&parts)?;
                say!(
                    "job {number}: {} of {} parts; logs in {}",
                    parts.len(),
                    job.parts,
                    job.folder.display()
                );
                number
            }
        };
        follow(&number, folder, total, noun)?;
        job.forget()?;
    }
}

/// Returns when the job has ended.
fn follow(number: &str, folder: &Folder, total: u64, noun: &str) -> anyhow::Result<()> {
    let mut heard = Instant::now();
    loop {
        match queued(number) {
            Ok(None) => break,
            Ok(Some((waiting, running))) => {
                heard = Instant::now();
                let done = folder.done()?;
                show(&format!("{done}/{total} {noun}; {running} tasks run, {waiting} wait"));
            }
            Err(error @ SlurmError::Refused { .. }) if heard.elapsed() < PATIENCE => show(&error.to_string()),
            Err(error @ SlurmError::Refused { .. }) => {
                bail!(
                    "{error}. Nothing is lost: job {number} goes on without this command, and the same command follows it again"
                )
            }
            Err(error) => return Err(error.into()),
        }
        std::thread::sleep(TICK);
    }
    if std::io::stderr().is_terminal() {
        tell("");
    }
    Ok(())
}

fn show(state: &str) {
    let mut terminal = std::io::stderr().lock();
    if terminal.is_terminal() {
        // The job goes on if the terminal is closed.
        let _ = write!(terminal, "\r\x1b[K{}", printable(state)).and_then(|()| terminal.flush());
    }
}
