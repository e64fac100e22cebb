//! Campaigns on a Slurm cluster: an array job with a task for each part.
//!
//! Slurm decides where and when a part runs, and runs it again where a machine is lost. A part computes the runs of its own
//! that have no row yet, so it may be interrupted and repeated at any point. What is kept here is one file, `slurm/job` in
//! the campaign's folder, with the job's number: a submitter that is killed finds its job again.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use thiserror::Error;
use whorl_math::words::shell_word;

use crate::part::Part;

/// Why a cluster cannot be used.
#[derive(Debug, Error)]
pub enum SlurmError {
    /// Slurm's commands are not there.
    #[error(
        "there is no `{0}` on this machine: --engine slurm is for the login node of a Slurm cluster; --engine local runs here"
    )]
    NotThere(&'static str),
    /// A command could not be started.
    #[error("cannot run {command}: {source}")]
    NotRun {
        /// Which.
        command: &'static str,
        /// The reason.
        source: io::Error,
    },
    /// A command refused.
    #[error("{command}: {said}")]
    Refused {
        /// Which.
        command: &'static str,
        /// What it said.
        said: String,
    },
    /// A file of the campaign's folder.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
}

/// What becomes an array job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Its name in the queue.
    pub name: String,
    /// The program with its arguments; `--part` and `--threads` are added for each task.
    pub command: Vec<String>,
    /// Where it runs: the same folder as here, on every machine.
    pub directory: PathBuf,
    /// Folder for its script, its logs and its number.
    pub folder: PathBuf,
    /// How many parts the campaign has.
    pub parts: u64,
    /// Options for `sbatch`.
    pub options: Vec<String>,
}

impl Job {
    /// The script of every task.
    #[must_use]
    pub fn script(&self) -> String {
        let command: Vec<String> = self.command.iter().map(|word| shell_word(word)).collect();
        format!(
            "#!/bin/sh\n# One part of a campaign; `whorl campaign --engine slurm` wrote and submitted this.\nexec {} --part \"$SLURM_ARRAY_TASK_ID/{}\" \
             --threads \"${{SLURM_CPUS_PER_TASK:-1}}\"\n",
            command.join(" "),
            self.parts
        )
    }

    fn number_file(&self) -> PathBuf {
        self.folder.join("job")
    }

    /// The job that was submitted before and has not been seen to end.
    #[must_use]
    pub fn submitted(&self) -> Option<String> {
        let number = fs::read_to_string(self.number_file()).ok()?;
        Some(number.trim().to_owned()).filter(|number| !number.is_empty())
    }

    /// Forgets the job: it has ended.
    ///
    /// # Errors
    /// The file system's.
    pub fn forget(&self) -> Result<(), SlurmError> {
        let path = self.number_file();
        fs::remove_file(&path).map_err(|source| SlurmError::Io { action: "remove", path, source })
    }

    /// Writes the script, submits these parts, and returns the job's number.
    ///
    /// # Errors
    /// No `sbatch`, what it refuses, the file system's.
    pub fn submit(&self, parts: &[Part]) -> Result<String, SlurmError> {
        let io = |action, path: &Path| {
            let path = path.to_owned();
            move |source| SlurmError::Io { action, path, source }
        };
        fs::create_dir_all(&self.folder).map_err(io("create", &self.folder))?;
        let script = self.folder.join("part.sh");
        whorl_files::write_file(&script, self.script()).map_err(io("write", &script))?;
        let numbers: Vec<u64> = parts.iter().map(|part| part.number()).collect();
        let mut command = Command::new("sbatch");
        command
            .args(["--parsable", "--requeue"])
            .arg(format!("--job-name={}", self.name))
            .arg(format!("--array={}", ranges(&numbers)))
            .arg(format!("--chdir={}", self.directory.display()))
            .arg(format!("--output={}", self.folder.join("%A_%a.log").display()))
            .args(&self.options)
            .arg(&script);
        let said = output("sbatch", &mut command)?;
        if !said.status.success() {
            return Err(refused("sbatch", &said));
        }
        // "NUMBER" or "NUMBER;CLUSTER".
        let text = String::from_utf8_lossy(&said.stdout).trim().to_owned();
        let number = text.split(';').next().unwrap_or_default().to_owned();
        if number.is_empty() || !number.bytes().all(|b| b.is_ascii_digit()) {
            return Err(SlurmError::Refused {
                command: "sbatch",
                said: format!("no job number in `{text}`"),
            });
        }
        let path = self.number_file();
        whorl_files::write_file(&path, format!("{number}\n")).map_err(io("write", &path))?;
        Ok(number)
    }
}

/// How many tasks of a job wait, and how many run; `None`: it has ended.
///
/// # Errors
/// No `squeue`; what it says where the controller does not answer.
pub fn queued(number: &str) -> Result<Option<(usize, usize)>, SlurmError> {
    let mut command = Command::new("squeue");
    command.args(["--noheader", "--array", "--format=%T", "--jobs", number]);
    let said = output("squeue", &mut command)?;
    if !said.status.success() {
        // Jobs that ended some minutes ago are unknown.
        return match String::from_utf8_lossy(&said.stderr).contains("Invalid job id") {
            true => Ok(None),
            false => Err(refused("squeue", &said)),
        };
    }
    Ok(counted(&String::from_utf8_lossy(&said.stdout)))
}

/// Tasks that wait and that run, of a list of states.
fn counted(states: &str) -> Option<(usize, usize)> {
    let waiting = |state: &&str| matches!(*state, "PENDING" | "REQUEUED" | "REQUEUE_HOLD" | "SPECIAL_EXIT");
    let ended = |state: &&str| {
        let over = ["COMPLETED", "CANCELLED", "FAILED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "DEADLINE"];
        over.contains(state) || matches!(*state, "BOOT_FAIL" | "PREEMPTED" | "REVOKED")
    };
    let alive: Vec<&str> =
        states.lines().map(str::trim).filter(|s| !s.is_empty()).filter(|s| !ended(s)).collect();
    let waits = alive.iter().filter(|state| waiting(state)).count();
    (!alive.is_empty()).then(|| (waits, alive.len() - waits))
}

fn output(name: &'static str, command: &mut Command) -> Result<Output, SlurmError> {
    command.output().map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => SlurmError::NotThere(name),
        _ => SlurmError::NotRun { command: name, source },
    })
}

fn refused(command: &'static str, said: &Output) -> SlurmError {
    SlurmError::Refused { command, said: String::from_utf8_lossy(&said.stderr).trim().to_owned() }
}

/// `0-3,7` of ascending numbers.
fn ranges(numbers: &[u64]) -> String {
    let mut all: Vec<(u64, u64)> = Vec::new();
    for number in numbers {
        match all.last_mut() {
            Some((_, last)) if *last + 1 == *number => *last = *number,
            _ => all.push((*number, *number)),
        }
    }
    let one = |(first, last): &(u64, u64)| {
        if first == last { first.to_string() } else { format!("{first}-{last}") }
    };
    all.iter().map(one).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_ranges_and_states_counts() {
        assert_eq!(ranges(&[0, 1, 2, 3, 7, 9, 10]), "0-3,7,9-10");
        assert_eq!(ranges(&[4]), "4");
        assert_eq!(counted("PENDING\nRUNNING\nCOMPLETING\nCOMPLETED\n"), Some((1, 2)));
        assert_eq!(counted("COMPLETED\nFAILED\n"), None);
        assert_eq!(counted(""), None);
    }

    #[test]
    fn a_shell_takes_the_words_of_the_script_as_they_are() {
        let job = Job {
            name: "x".to_owned(),
            command: ["printf", "%s|", "a b", "it's", "$HOME"].map(str::to_owned).to_vec(),
            directory: PathBuf::from("/"),
            folder: PathBuf::from("/"),
            parts: 16,
            options: Vec::new(),
        };
        let shell = Command::new("sh")
            .args(["-c", &job.script()])
            .env("SLURM_ARRAY_TASK_ID", "3")
            .env_remove("SLURM_CPUS_PER_TASK")
            .output()
            .unwrap();
        assert_eq!(String::from_utf8(shell.stdout).unwrap(), "a b|it's|$HOME|--part|3/16|--threads|1|");
    }
}
