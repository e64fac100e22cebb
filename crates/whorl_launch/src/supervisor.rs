//! Running processes.

use std::ffi::OsString;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, getpriority_process, kill_process, setpriority_process};
use whorl_node::Node;

use crate::domain::Domain;
use crate::error::LaunchError;
use crate::process::{Process, Programs};
use crate::realtime::RealTime;
use crate::restarts::Restarts;

/// Nodes get a higher priority than other programs if the machine allows it: as root, or with a limit on nice in
/// /etc/security/limits.conf.
const NICE: i32 = -10;
/// Time for nodes to end after they were asked to.
const NODES_END: Duration = Duration::from_secs(3);
/// The same for the recorder, which closes its files.
const RECORDER_ENDS: Duration = Duration::from_secs(5);
/// Exit code of a Rust program that panicked.
const PANICKED: i32 = 101;
/// Exit code of a node that was told something that it does not take (`whorl_ros::WRONG_USAGE`): it ended as it began.
const WRONG_USAGE: i32 = 2;
/// Number of log lines shown for a failed process, ...
const LAST_LINES: usize = 20;
/// ... of so many bytes at its end.
const LAST_BYTES: u64 = 16 << 10;

/// In the environment of a node: it ends when its standard input does, which is the launcher's end (`whorl_ros` reads it). The
/// kernel's own signal for that (`PR_SET_PDEATHSIG`) comes when the *thread* ends that started the process.
const ENDS_WITH_INPUT: &str = "WHORL_ENDS_WITH_INPUT";
/// In the environment of a coordinator: the file in which it keeps how far its experiment has come (`nodes/programs` reads it).
const PROGRESS_FILE: &str = "WHORL_PROGRESS_FILE";

/// Processes that were started here. They end when this is dropped, and when this process is killed.
#[derive(Debug)]
pub struct Supervisor {
    children: Vec<Running>,
    domain: Domain,
    environment: Vec<(String, String)>,
    real_time: Option<RealTime>,
}

#[derive(Debug)]
struct Running {
    label: String,
    node: Node,
    program: PathBuf,
    arguments: Vec<OsString>,
    child: Child,
    log: PathBuf,
    ended: bool,
    /// Whether it was asked to end.
    asked: bool,
    restarts: Restarts,
    /// When it is started again.
    again_at: Option<Instant>,
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

/// How everything ended.
#[derive(Debug, Default)]
pub struct Stopped {
    /// Labels of processes that did not end in time and were killed.
    pub killed: Vec<String>,
    /// Processes that ended, when they were asked to, saying that they had failed.
    pub failed: Vec<Ended>,
}

impl Ended {
    /// Whether it came to its end by an accident, not by its own decision: by a signal (the kernel's, when memory or
    /// its limit is exhausted, among them), or by a panic.
    #[must_use]
    pub fn by_accident(&self) -> bool {
        by_accident(self.status)
    }

    /// Why, by its log: the last lines; of a process that ended as it began the first, as what follows them may follow from them.
    #[must_use]
    pub fn last_words(&self) -> String {
        let log = end_of(&self.log).unwrap_or_default();
        let text = String::from_utf8_lossy(&log);
        let lines: Vec<&str> = text.lines().collect();
        let most = LAST_LINES.min(lines.len());
        let shown =
            if self.status.code() == Some(WRONG_USAGE) { 0..most } else { lines.len() - most..lines.len() };
        lines.get(shown).unwrap_or_default().join("\n")
    }
}

/// The end of a file that may have grown for days.
fn end_of(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(LAST_BYTES)))?;
    let mut end = Vec::new();
    file.take(LAST_BYTES).read_to_end(&mut end)?;
    Ok(end)
}

/// Whether a process ended by a signal or a panic, see [`Ended::by_accident`].
#[must_use]
pub fn by_accident(status: ExitStatus) -> bool {
    status.code().is_none_or(|code| code == PANICKED)
}

impl Supervisor {
    /// Nothing runs yet.
    #[must_use]
    pub fn new(domain: Domain) -> Self {
        Self { children: Vec::new(), domain, environment: Vec::new(), real_time: None }
    }

    /// With these variables in the environment of every process that it starts.
    #[must_use]
    pub fn with_environment(mut self, environment: Vec<(String, String)>) -> Self {
        self.environment = environment;
        self
    }

    /// With real-time priority for those of its processes that a control loop goes through.
    #[must_use]
    pub fn with_real_time(mut self, real_time: Option<RealTime>) -> Self {
        self.real_time = real_time;
        self
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
        let program = programs.path(node)?;
        let environment = self.environment_of(&label, node);
        let command = command(&program, &arguments, &environment, file, &log)?;
        let progress = self.domain.progress(&label);
        // What is left of an earlier experiment must not go on in this one.
        if let Err(error) = std::fs::remove_file(&progress)
            && error.kind() != std::io::ErrorKind::NotFound
        {
            return Err(LaunchError::io("cannot remove", &progress)(error));
        }
        // Before the process runs, which may keep its progress there at once. Without it only that is missing, and what
        // `Domain::remember` keeps.
        let _ = self.domain.create_folder();
        let child = spawn(command, self.real_time.as_ref(), node, &program)?;
        self.domain.remember(&label, child.id());
        let running = Running {
            label,
            node,
            program,
            arguments,
            child,
            log,
            ended: false,
            asked: false,
            restarts: Restarts::default(),
            again_at: None,
        };
        self.children.push(running);
        Ok(())
    }

    /// What every process gets, and where a coordinator keeps how far its experiment has come.
    fn environment_of(&self, label: &str, node: Node) -> Vec<(OsString, OsString)> {
        let all = self.environment.iter().map(|(name, value)| (name.into(), value.into()));
        let own =
            (node == Node::Coordinator).then(|| (PROGRESS_FILE.into(), self.domain.progress(label).into()));
        all.chain(own).collect()
    }

    /// Starts a process again that has ended by accident, at once or, when it has ended often, after the time that is returned
    /// ([`Self::start_due`]); `None` when there is no such process, or it runs. Its log goes on in the same file. A recorder goes
    /// on in a directory of its own, whose name ends with a number: a bag that was not closed is not written to again. A
    /// coordinator goes on with its experiment.
    ///
    /// # Errors
    /// When the program, or the log, cannot be opened.
    pub fn restart(&mut self, label: &str) -> Result<Option<Duration>, LaunchError> {
        let Some(running) = self.children.iter_mut().find(|r| r.label == label && r.ended) else {
            return Ok(None);
        };
        let wait = running.restarts.next_wait(Instant::now());
        if wait > Duration::ZERO {
            running.again_at = Some(Instant::now() + wait);
        } else {
            self.start_again(label)?;
        }
        Ok(Some(wait))
    }

    /// Starts those again whose time has come: their labels, and what went wrong.
    pub fn start_due(&mut self) -> Vec<(String, Result<(), LaunchError>)> {
        let now = Instant::now();
        let due = self.children.iter_mut().filter(|r| r.again_at.is_some_and(|at| at <= now));
        let due: Vec<String> = due
            .map(|running| {
                running.again_at = None;
                running.label.clone()
            })
            .collect();
        let start = |label: String| {
            let started = self.start_again(&label);
            (label, started)
        };
        due.into_iter().map(start).collect()
    }

    fn start_again(&mut self, label: &str) -> Result<(), LaunchError> {
        let Some(node) = self.children.iter().find(|r| r.label == label && r.ended).map(|r| r.node) else {
            return Ok(());
        };
        let environment = self.environment_of(label, node);
        let Some(running) = self.children.iter_mut().find(|r| r.label == label && r.ended) else {
            return Ok(());
        };
        if running.node == Node::Recorder {
            running.arguments.iter_mut().for_each(number_run_directory);
        }
        // A log that is gone, as when the run directory was deleted, must not keep the node from running.
        let file = File::options()
            .append(true)
            .open(&running.log)
            .or_else(|_| File::options().write(true).open("/dev/null"))
            .map_err(LaunchError::io("cannot write to", &running.log))?;
        let command = command(&running.program, &running.arguments, &environment, file, &running.log)?;
        running.child = spawn(command, self.real_time.as_ref(), running.node, &running.program)?;
        running.ended = false;
        self.domain.remember(label, running.child.id());
        Ok(())
    }

    /// Closes what the nodes read, as the kernel does when this process is killed.
    #[cfg(test)]
    pub(crate) fn let_go(&mut self) {
        self.children.iter_mut().for_each(|running| drop(running.child.stdin.take()));
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
    pub fn stop(&mut self) -> Stopped {
        let (mut recorders, mut others): (Vec<Running>, Vec<Running>) =
            self.children.drain(..).partition(|running| running.node == Node::Recorder);
        let mut killed = end(&mut others, NODES_END);
        killed.extend(end(&mut recorders, RECORDER_ENDS));
        let mut failed = Vec::new();
        for running in others.iter_mut().chain(&mut recorders) {
            self.domain.forget(&running.label);
            // Waited for already: this only repeats how it ended. Others were reported when they ended.
            // One that ended by our own signal had not begun to listen for it.
            let as_asked =
                |status: &ExitStatus| status.success() || status.signal() == Some(Signal::TERM.as_raw());
            let status = running.child.try_wait().ok().flatten();
            let status = status.filter(|status| running.asked && !as_asked(status));
            let killed = killed.contains(&running.label);
            failed.extend(status.filter(|_| !killed).map(|status| Ended {
                label: running.label.clone(),
                status,
                log: running.log.clone(),
            }));
        }
        Stopped { killed, failed }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop();
    }
}

fn command(
    program: &Path,
    arguments: &[OsString],
    environment: &[(OsString, OsString)],
    log: File,
    log_path: &Path,
) -> Result<Command, LaunchError> {
    let errors = log.try_clone().map_err(LaunchError::io("cannot write to", log_path))?;
    let mut command = Command::new(program);
    command.args(arguments).envs(environment.iter().cloned()).stdout(log).stderr(errors);
    ends_with_this_process(&mut command);
    Ok(command)
}

/// Has a process end when this one does, however it does, and not by Ctrl-C: that is for this one, which ends its processes in
/// order. The process must listen for it (`whorl_ros::end_with_launcher`).
pub fn ends_with_this_process(command: &mut Command) -> &mut Command {
    // The kernel closes the other end when this process ends.
    command.stdin(Stdio::piped()).env(ENDS_WITH_INPUT, "1").process_group(0)
}

fn spawn(
    mut command: Command,
    real_time: Option<&RealTime>,
    node: Node,
    program: &Path,
) -> Result<Child, LaunchError> {
    let child = match (real_time, RealTime::priority(node)) {
        (Some(real_time), Some(priority)) => real_time.spawn(priority, &mut command),
        _ => ahead(|| command.spawn()),
    };
    child.map_err(LaunchError::io("cannot start", program))
}

/// `run_directory:=RUN` becomes `run_directory:=RUN_part2`, then `RUN_part3`.
fn number_run_directory(argument: &mut OsString) {
    const KEY: &str = "run_directory:=";
    let Some(path) = argument.to_str().and_then(|text| text.strip_prefix(KEY)) else { return };
    let (stem, number) = path
        .rsplit_once("_part")
        .and_then(|(stem, number)| Some((stem, number.parse::<u32>().ok()?)))
        .unwrap_or((path, 1));
    *argument = format!("{KEY}{stem}_part{}", number.saturating_add(1)).into();
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
            running.asked = true;
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
