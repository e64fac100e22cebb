//! Commands that are run one after the other in a folder of their own.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::Instant;

use anyhow::{Context, bail};
use thiserror::Error;
use whorl_launch::run_to_end;

use crate::output::say;
use crate::run::Interrupted;

/// Lines of a log that are shown when a step fails.
const LAST_LINES: usize = 20;

/// How `whorl run` begins what it advises to do.
const ADVICE: &str = "advice: ";

/// The user has stopped the session.
#[derive(Debug, Error)]
#[error("stopped")]
pub struct Stopped;

/// A folder, and the ROS domain in which its experiments run.
pub struct Session {
    /// Where everything goes.
    pub folder: PathBuf,
    /// Whether the folder stays.
    pub kept: bool,
    root: PathBuf,
    domain: String,
    began: Instant,
    interrupted: Interrupted,
}

impl Drop for Session {
    fn drop(&mut self) {
        if !self.kept {
            // Only what this session has written.
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

impl Session {
    /// In `out`, which must be empty, or in a folder that is removed at the end. `root` holds params/.
    pub fn new(out: Option<&Path>, root: &Path) -> anyhow::Result<Self> {
        let own = std::env::temp_dir().join(format!("whorl_demo_{}", std::process::id()));
        let folder = out.map_or(own, Path::to_owned);
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let folder = absolute(&folder)?;
        if std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
            bail!("{} is not empty; allowed: a new or empty folder", folder.display());
        }
        // Nobody else's nodes: no other experiment's of this machine.
        let of_this_process = || (50 + std::process::id() % 50).to_string();
        Ok(Self {
            folder,
            kept: out.is_some(),
            root: absolute(root)?,
            domain: std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| of_this_process()),
            began: Instant::now(),
            interrupted: Interrupted::new()?,
        })
    }

    /// A headline with the time so far.
    pub fn headline(&self, text: &str) {
        say!("\n== {text}  [{} s]", self.seconds());
    }

    /// Seconds since the beginning.
    pub fn seconds(&self) -> u64 {
        self.began.elapsed().as_secs()
    }

    /// Prints a command as a user types it in the folder, carries it out, and prints the first `lines` lines of its answer.
    pub fn show(&self, arguments: &[&str], lines: usize) -> anyhow::Result<()> {
        say!("$ whorl {}", arguments.join(" "));
        let log = self.folder.join("answer.log");
        let status = self.whorl(arguments, &log)?;
        let answer = std::fs::read_to_string(&log).unwrap_or_default();
        let shown = if status.success() { lines } else { usize::MAX };
        answer.lines().take(shown).for_each(|line| say!("{line}"));
        if !status.success() {
            bail!("whorl {} failed", arguments.first().unwrap_or(&""));
        }
        let _ = std::fs::remove_file(&log);
        Ok(())
    }

    /// Runs an experiment of one platform over DDS. Returns its run directory, relative to the folder.
    pub fn experiment(
        &self,
        into: &str,
        experiment: &str,
        platform: &str,
        seed: u64,
    ) -> anyhow::Result<String> {
        let log = self.folder.join(format!("{into}.log"));
        let (root, seed) = (self.root.display().to_string(), seed.to_string());
        let arguments = ["run", experiment, "--platforms", platform, "--params", "params"];
        let options = ["--out", into, "--seed", &seed, "--root", &root];
        let status = self.whorl(&[&arguments[..], &options].concat(), &log)?;
        if !status.success() {
            let text = std::fs::read_to_string(&log).unwrap_or_default();
            bail!("the experiment failed:\n{}", last_words(&text));
        }
        let runs = std::fs::read_dir(self.folder.join(into)).context("nothing was recorded")?;
        let run = runs.flatten().find(|entry| entry.path().is_dir()).context("nothing was recorded")?;
        let run = format!("{into}/{}", run.file_name().to_string_lossy());
        say!("recorded {run}");
        Ok(run)
    }

    /// Carries out a command of this program in the folder; its output goes to a file.
    fn whorl(&self, arguments: &[&str], log: &Path) -> anyhow::Result<ExitStatus> {
        let file = File::create(log).with_context(|| format!("cannot write {}", log.display()))?;
        let mut command = Command::new(std::env::current_exe().context("cannot find this program")?);
        command
            .args(arguments)
            .current_dir(&self.folder)
            .env("ROS_DOMAIN_ID", &self.domain)
            // No other machine's nodes either.
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("ROS_LOCALHOST_ONLY", "1")
            .stdin(Stdio::null())
            .stdout(file.try_clone().with_context(|| format!("cannot write {}", log.display()))?)
            .stderr(file);
        match run_to_end(&mut command, || self.interrupted.yes())? {
            Some(status) => Ok(status),
            None => Err(Stopped.into()),
        }
    }
}

/// The end of what `whorl run` said, with what it advises to do last.
fn last_words(text: &str) -> String {
    let (advice, lines): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with(ADVICE));
    let last = lines.get(lines.len().saturating_sub(LAST_LINES)..).unwrap_or_default();
    [last, &advice].concat().join("\n")
}

fn absolute(path: &Path) -> anyhow::Result<PathBuf> {
    path.canonicalize().with_context(|| format!("no folder {}", path.display()))
}

/// Copies a folder with everything in it.
pub fn copy_folder(from: &Path, to: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(to).with_context(|| format!("cannot create {}", to.display()))?;
    for entry in std::fs::read_dir(from).with_context(|| format!("cannot read {}", from.display()))? {
        let (source, target) = entry.map(|e| (e.path(), to.join(e.file_name())))?;
        if source.is_dir() {
            copy_folder(&source, &target)?;
        } else {
            std::fs::copy(&source, &target)
                .with_context(|| format!("cannot copy {} to {}", source.display(), target.display()))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_failed_ends_with_what_to_do() {
        let log: String = (0..100).map(|k| format!("line {k}\n")).collect();
        let words =
            last_words(&format!("{log}advice: end other programs\nreport: r\nverdict: FAILED: safe mode\n"));
        assert!(
            words.ends_with("report: r\nverdict: FAILED: safe mode\nadvice: end other programs"),
            "{words}"
        );
        assert_eq!(words.lines().count(), LAST_LINES + 1);
        assert!(!last_words(&log).contains(ADVICE));
    }
}
