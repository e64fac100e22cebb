//! A process that ends with its test.

use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};

use super::machine::prefer;

/// A process that was started here. Dropping it interrupts it, and kills it if that does not help.
pub struct Process {
    child: Child,
    name: String,
    log: PathBuf,
    stopped: bool,
    status: Option<ExitStatus>,
}

impl Process {
    /// Starts it as a terminal does: as the first of a process group, to which [`Self::ctrl_c`] goes. Ctrl-C on
    /// the test does not reach it.
    pub fn start_in_group(name: &str, mut command: Command, log: &Path) -> Self {
        command.process_group(0);
        Self::start(name, command, log)
    }

    /// Starts it, with everything it prints appended to `log`.
    pub fn start(name: &str, mut command: Command, log: &Path) -> Self {
        let file = File::options().create(true).append(true).open(log).unwrap();
        command.stdin(Stdio::null()).stdout(file.try_clone().unwrap()).stderr(file);
        let child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        // Before it starts threads, which inherit this.
        prefer(Some(Pid::from_child(&child)));
        Self { child, name: name.to_owned(), log: log.to_owned(), stopped: false, status: None }
    }

    /// What it has printed.
    pub fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Sends a signal to a process that has not been waited for.
    pub fn signal(&mut self, signal: Signal) {
        if self.ended().is_some() {
            return;
        }
        let pid = Pid::from_child(&self.child);
        kill_process(pid, signal).unwrap();
        match signal {
            Signal::STOP => self.stopped = true,
            Signal::CONT => self.stopped = false,
            _ => {}
        }
    }

    /// Ctrl-C as a terminal gives it: to the process, which has a group, and to all that it started.
    pub fn ctrl_c(&mut self) {
        if self.ended().is_none() {
            kill_process_group(Pid::from_child(&self.child), Signal::INT).unwrap();
        }
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.child.try_wait().unwrap();
        }
        self.status
    }

    /// Kills it as a power failure would, and waits until it is gone.
    pub fn kill(&mut self) {
        self.signal(Signal::KILL);
        self.status = Some(self.child.wait().unwrap());
    }

    /// Waits for its end.
    pub fn wait(&mut self, timeout: Duration) -> ExitStatus {
        let begin = Instant::now();
        loop {
            if let Some(status) = self.ended() {
                return status;
            }
            assert!(
                begin.elapsed() < timeout,
                "{} has not ended within {timeout:?}; its log:\n{}",
                self.name,
                self.log()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Interrupts it (Ctrl-C) and waits for its end.
    pub fn interrupt(&mut self, timeout: Duration) -> ExitStatus {
        self.signal(Signal::INT);
        self.wait(timeout)
    }

    /// Memory in use [bytes] and processor time so far [s], from /proc.
    pub fn resources(&self) -> Option<(u64, f64)> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let resident = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
        let kib: u64 = resident.trim().trim_end_matches(" kB").trim().parse().ok()?;
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id())).ok()?;
        // The name in parentheses may hold spaces; the 14th and 15th fields are counted from its end.
        let fields: Vec<&str> = stat.rsplit(')').next()?.split_whitespace().collect();
        let ticks: u64 = fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?;
        Some((kib * 1024, ticks as f64 / 100.0))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if !matches!(self.child.try_wait(), Ok(None)) {
            return;
        }
        if self.stopped {
            self.signal(Signal::CONT);
        }
        self.signal(Signal::INT);
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(3) {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
