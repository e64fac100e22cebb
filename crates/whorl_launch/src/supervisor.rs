//! Running processes.

use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, getpriority_process, kill_process, setpriority_process};
use whorl_node::Node;

use crate::domain::Domain;
use crate::error::LaunchError;
use crate::process::{Process, Programs};

/// Nodes get a higher priority than other programs if the machine allows it: as root, or with a limit on nice in
/// /etc/security/limits.conf.
const NICE: i32 = -10;
/// Time for nodes to end after they were asked to.
const NODES_END: Duration = Duration::from_secs(3);
/// The same for the recorder, which closes its files.
const RECORDER_ENDS: Duration = Duration::from_secs(5);
/// Number of log lines shown for a failed process.
const LAST_LINES: usize = 20;

/// Processes that were started here. They end when this is dropped.
#[derive(Debug)]
pub struct Supervisor {
    children: Vec<Running>,
    domain: Domain,
}

#[derive(Debug)]
struct Running {
    label: String,
    node: Node,
    child: Child,
    log: PathBuf,
    ended: bool,
}

/// A process that has ended by itself.
#[derive(Debug)]
pub struct Ended {
    /// Which.
    pub label: String,
    /// How.
    pub status: ExitStatus,
    /// Its log file.
    pub log: PathBuf,
}

impl Ended {
    /// The last lines of its log.
    #[must_use]
    pub fn last_words(&self) -> String {
        let log = std::fs::read(&self.log).unwrap_or_default();
        let text = String::from_utf8_lossy(&log);
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(LAST_LINES)..].join("\n")
    }
}

impl Supervisor {
    /// Nothing runs yet.
    #[must_use]
    pub fn new(domain: Domain) -> Self {
        Self { children: Vec::new(), domain }
    }

    /// Starts a process whose output goes to `LOGS/LABEL.log`.
    ///
    /// # Errors
    /// When the program, or the log, cannot be opened.
    pub fn start(&mut self, programs: &Programs, process: Process, logs: &Path) -> Result<(), LaunchError> {
        let Process { label, node, arguments } = process;
        std::fs::create_dir_all(logs).map_err(LaunchError::io("cannot create", logs))?;
        let log = logs.join(format!("{label}.log"));
        let file = File::create(&log).map_err(LaunchError::io("cannot create", &log))?;
        let errors = file.try_clone().map_err(LaunchError::io("cannot write to", &log))?;
        let program = programs.path(node)?;
        let mut command = Command::new(&program);
        command.args(arguments).stdin(Stdio::null()).stdout(file).stderr(errors);
        // Ctrl-C goes to the terminal's process group, which holds only the supervisor: it ends the nodes in order.
        command.process_group(0);
        let child = ahead(|| command.spawn()).map_err(LaunchError::io("cannot start", &program))?;
        self.domain.remember(&label, child.id());
        self.children.push(Running { label, node, child, log, ended: false });
        Ok(())
    }

    /// A process that has ended since the last call.
    pub fn ended(&mut self) -> Option<Ended> {
        self.children.iter_mut().filter(|running| !running.ended).find_map(|running| {
            let status = running.child.try_wait().ok().flatten()?;
            running.ended = true;
            Some(Ended { label: running.label.clone(), status, log: running.log.clone() })
        })
    }

    /// Ends everything, the recorder last, so that it records how the others end. Processes that do not end in time are
    /// killed and named.
    pub fn stop(&mut self) -> Vec<String> {
        let (mut recorders, mut others): (Vec<Running>, Vec<Running>) =
            self.children.drain(..).partition(|running| running.node == Node::Recorder);
        let mut killed = end(&mut others, NODES_END);
        killed.extend(end(&mut recorders, RECORDER_ENDS));
        for running in others.iter().chain(&recorders) {
            self.domain.forget(&running.label);
        }
        killed
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Runs with the nodes' priority, which a process that is started meanwhile inherits from its first instruction on.
fn ahead<T>(start: impl FnOnce() -> T) -> T {
    let before = getpriority_process(None);
    let raised = setpriority_process(None, NICE).is_ok();
    let started = start();
    if let (true, Ok(before)) = (raised, before) {
        let _ = setpriority_process(None, before);
    }
    started
}

/// Replaces this process by a node.
///
/// # Errors
/// When the program cannot be started; otherwise it does not return.
pub fn become_node(programs: &Programs, process: Process) -> Result<std::convert::Infallible, LaunchError> {
    let program = programs.path(process.node)?;
    let error = ahead(|| Command::new(&program).args(process.arguments).exec());
    Err(LaunchError::io("cannot start", program)(error))
}

/// Terminates these processes and kills the remaining ones after a time. INT is not used, because a process ignores it
/// when it was started in the background of a script.
fn end(processes: &mut [Running], within: Duration) -> Vec<String> {
    let began = Instant::now();
    for running in processes.iter_mut() {
        if !has_ended(running) {
            send(running, Signal::TERM);
        }
    }
    while began.elapsed() < within {
        if processes.iter_mut().all(has_ended) {
            return Vec::new();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let mut killed = Vec::new();
    for running in processes.iter_mut() {
        if !has_ended(running) {
            send(running, Signal::KILL);
            let _ = running.child.wait();
            killed.push(running.label.clone());
        }
    }
    killed
}

fn has_ended(running: &mut Running) -> bool {
    running.ended |= matches!(running.child.try_wait(), Ok(Some(_)) | Err(_));
    running.ended
}

/// Only for a child that has not been waited for, so that its id cannot belong to another process.
fn send(running: &Running, signal: Signal) {
    let _ = kill_process(Pid::from_child(&running.child), signal);
}
