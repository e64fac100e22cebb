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

/// A folder, and how its experiments are run.
pub struct Session {
    /// Where everything goes.
    pub folder: PathBuf,
    /// The ROS domain of experiments over DDS; `None`: they are simulated in one process.
    domain: Option<String>,
    began: Instant,
    interrupted: Interrupted,
}

impl Session {
    /// In `out`, which must be empty, or in a folder among the system's temporary files.
    pub fn new(out: Option<&Path>, dds: bool) -> anyhow::Result<Self> {
        let folder = match out {
            Some(out) => {
                std::fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
                out.to_owned()
            }
            None => tempfile::Builder::new()
                .prefix("whorl_demo_")
                .tempdir()
                .context("cannot create a folder for temporary files; name one with --out")?
                .keep(),
        };
        let folder = folder.canonicalize().with_context(|| format!("no folder {}", folder.display()))?;
        if std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
            bail!("{} is not empty; allowed: a new or empty folder", folder.display());
        }
        // Nobody else's nodes: no other experiment's of this machine.
        let own = || (50 + std::process::id() % 50).to_string();
        Ok(Self {
            folder,
            domain: dds.then(|| std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| own())),
            began: Instant::now(),
            interrupted: Interrupted::new()?,
        })
    }

    /// Says where everything is, and shows the last page in a browser where there is a desktop.
    pub fn end(&self, open: bool) {
        let pages = ["adopt", "discover", "diagnose", "where", "compare"];
        let written = pages.iter().map(|page| self.folder.join(format!("{page}.html"))).find(|p| p.is_file());
        say!(
            "\nparameters, runs and pages are in {}; every command above can be repeated there",
            self.folder.display()
        );
        let Some(page) = written else { return };
        // Each page has links to the others.
        say!("pages: {}", page.display());
        let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        if open && (is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")) {
            let nothing = Stdio::null;
            // It is shown to those who have a browser; the others have its path.
            let _ = Command::new("xdg-open")
                .arg(page)
                .stdin(nothing())
                .stdout(nothing())
                .stderr(nothing())
                .spawn();
        }
    }

    /// A headline with the time so far.
    pub fn headline(&self, text: &str) {
        say!("\n== {text}  [{} s]", self.seconds());
    }

    /// Seconds since the beginning.
    pub fn seconds(&self) -> u64 {
        self.began.elapsed().as_secs()
    }

    /// Prints a command as a user types it in the folder, carries it out, and prints the first `lines` lines of its answer. Its
    /// progress, and what goes wrong, go to the standard error.
    pub fn show(&self, arguments: &[&str], lines: usize) -> anyhow::Result<()> {
        say!("$ whorl {}", arguments.join(" "));
        let log = self.folder.join("answer.log");
        let status = self.whorl(arguments, &log, true)?;
        let answer = std::fs::read_to_string(&log).unwrap_or_default();
        let shown = if status.success() { lines } else { usize::MAX };
        let mut shown: Vec<&str> = answer.lines().take(shown).collect();
        while shown.pop_if(|line| line.trim().is_empty()).is_some() {}
        shown.iter().for_each(|line| say!("{line}"));
        if !status.success() {
            bail!("whorl {} failed", arguments.first().unwrap_or(&""));
        }
        let _ = std::fs::remove_file(&log);
        Ok(())
    }

    /// Runs an experiment. Returns its run directory, relative to the folder. One that failed, as on a busy computer, is good
    /// enough if it was recorded: the data are judged by what comes next.
    pub fn experiment(&self, into: &str, experiment: &str, seed: u64) -> anyhow::Result<String> {
        let log = self.folder.join(format!("{into}.log"));
        let seed = seed.to_string();
        let options = ["--params", "params", "--seed", &seed, "--out", into];
        let arguments = match &self.domain {
            Some(_) => [&["run", experiment], &options[..]].concat(),
            None => [&["simulate", "--experiment", experiment], &options[..]].concat(),
        };
        say!("$ whorl {}", arguments.join(" "));
        let status = self.whorl(&arguments, &log, false)?;
        let run = match &self.domain {
            // One below the folder.
            Some(_) => std::fs::read_dir(self.folder.join(into)).ok().and_then(|entries| {
                let run = entries.flatten().find(|entry| entry.path().is_dir())?;
                Some(format!("{into}/{}", run.file_name().to_string_lossy()))
            }),
            None => Some(into.to_owned()),
        };
        let run = run.filter(|run| self.folder.join(run).join("bag").is_dir());
        if !status.success() {
            let text = std::fs::read_to_string(&log).unwrap_or_default();
            let words = last_words(&text);
            let Some(run) = run else { bail!("the experiment failed:\n{words}") };
            say!("{words}\nwarning: it failed, and goes on with what was recorded: {run}");
            return Ok(run);
        }
        let run = run.context("nothing was recorded")?;
        say!("recorded {run}");
        Ok(run)
    }

    /// Carries out a command of this program in the folder; its output goes to a file, and what it says on the standard error
    /// there too, unless that is to be seen.
    fn whorl(&self, arguments: &[&str], log: &Path, shows_errors: bool) -> anyhow::Result<ExitStatus> {
        let cannot_write = || format!("cannot write {}", log.display());
        let file = File::create(log).with_context(cannot_write)?;
        let errors = match shows_errors {
            true => Stdio::inherit(),
            false => file.try_clone().with_context(cannot_write)?.into(),
        };
        let mut command = Command::new(std::env::current_exe().context("cannot find this program")?);
        command
            .args(arguments)
            .current_dir(&self.folder)
            .envs(self.domain.iter().map(|domain| ("ROS_DOMAIN_ID", domain)))
            // No other machine's nodes either.
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("ROS_LOCALHOST_ONLY", "1")
            .stdin(Stdio::null())
            .stdout(file)
            .stderr(errors);
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
