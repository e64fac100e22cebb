//! `whorl run`: an experiment over DDS on this machine, from start to report, with a process for every node.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::Write as _;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Args;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use whorl_launch::{
    Backend, Domain, DriverSource, Ended, Programs, RealTime, Setup, SetupOptions, Supervisor,
};
use whorl_ros::environment::Network;

use crate::output::JsonArgument;
use crate::{report, security};

/// Exit status when nothing was started.
const NOT_STARTED: u8 = 2;
/// Exit status after Ctrl-C, as shells give it.
pub const INTERRUPTED: u8 = 130;
/// Interval at which the processes are polled.
const LOOK: Duration = Duration::from_millis(100);
/// Time between the starts of two secured nodes: each exchanges keys with all that are there already.
const BETWEEN_SECURED: Duration = Duration::from_millis(300);
/// Time that the monitor has to report the end of an experiment after the first node has finished.
const LAST_LOOK: Duration = Duration::from_secs(2);

#[derive(Debug, Args)]
pub struct Arguments {
    /// A name in params/experiments/, or a file.
    experiment: Option<String>,
    /// Platforms, e.g. "whorl_1 whorl_2" [default: those of the parameter files].
    #[arg(long, value_name = "\"A B\"", value_parser = names)]
    platforms: Option<Names>,
    /// Backend of the drivers, for one platform or all: sim, replay or hardware [default: sim].
    #[arg(long, value_name = "[PLATFORM=]KIND", value_parser = backend)]
    backend: Vec<(Option<String>, Backend)>,
    /// Recording for a platform with the replay backend: run, bag or CSV.
    #[arg(long, value_name = "PLATFORM=FILE", value_parser = of_platform)]
    source: Vec<(String, PathBuf)>,
    /// Map of the columns of a CSV recording, such as params/channels/broad.yaml.
    #[arg(long, value_name = "PLATFORM=FILE", value_parser = of_platform)]
    channels: Vec<(String, PathBuf)>,
    /// Folder of run directories [default: runs/].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of the simulated hardware.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Shows the run in a browser, at the address that is printed.
    #[arg(long)]
    live: bool,
    /// Port of the live page; 0: any free one.
    #[arg(long, default_value_t = crate::live::PORT, requires = "live")]
    live_port: u16,
    /// Authenticate and encrypt all traffic (SROS2), with the keys in ROS_SECURITY_KEYSTORE or, where that is not set,
    /// with new ones for this domain; nobody without keys takes part. Needs programs built with `--features security`.
    #[arg(long)]
    secure: bool,
    #[command(flatten)]
    scheduling: Scheduling,
    #[command(flatten)]
    json: JsonArgument,
    #[command(flatten)]
    folders: Folders,
}

/// How the operating system is to treat the nodes.
#[derive(Debug, Args)]
pub struct Scheduling {
    /// Real-time priority (SCHED_FIFO) and memory kept in RAM for drivers, estimators, local controls and the coordinator:
    /// for a computer that other programs load as well. `whorl doctor` says whether this user may.
    #[arg(long)]
    realtime: bool,
    /// Processors for these nodes, e.g. 2,3 [default: all].
    #[arg(long, value_name = "N,N", value_delimiter = ',', requires = "realtime")]
    cpus: Vec<usize>,
}

impl Scheduling {
    /// What was asked for, if the operating system allows it.
    pub fn real_time(&self) -> anyhow::Result<Option<RealTime>> {
        Ok(self.realtime.then(|| RealTime::on(self.cpus.clone())).transpose()?)
    }
}

/// Where parameters are.
#[derive(Debug, Args)]
pub struct Folders {
    /// Parameter folder [default: params/].
    #[arg(long, value_name = "DIR")]
    params: Option<PathBuf>,
    /// Folder of params/ and runs/; the run records its git commit.
    #[arg(long, value_name = "DIR", default_value = ".")]
    root: PathBuf,
}

/// What commands about one platform are told besides its name.
#[derive(Debug, Args)]
pub struct AboutPlatform {
    /// Experiment whose platforms it is one of: a name in params/experiments/, or a file.
    #[arg(long, value_name = "NAME|FILE", default_value = "hold")]
    experiment: String,
    #[command(flatten)]
    pub json: JsonArgument,
    #[command(flatten)]
    pub folders: Folders,
}

impl AboutPlatform {
    /// The experiment and its files.
    pub fn options(&self) -> SetupOptions {
        self.folders.options(&self.experiment)
    }
}

impl Folders {
    /// Options of the launch.
    pub fn options(&self, experiment: &str) -> SetupOptions {
        let params_of_whorl = self.root.join("params");
        SetupOptions {
            experiment: experiment.to_owned(),
            params: self.params.clone().unwrap_or_else(|| params_of_whorl.clone()),
            params_of_whorl,
            ..SetupOptions::default()
        }
    }

    /// Where runs are recorded.
    pub fn recordings(&self) -> PathBuf {
        self.root.join("runs")
    }

    /// Creates the directory of a new run.
    pub fn new_run(&self, out: Option<&Path>, setup: &Setup) -> anyhow::Result<PathBuf> {
        let runs = out.map_or_else(|| self.root.join("runs"), Path::to_owned);
        Ok(whorl_bag::new_run_directory(&runs, &setup.experiment_name(), whorl_ros::wall_clock())?)
    }
}

/// Names of platforms in one argument.
#[derive(Debug, Clone)]
pub struct Names(pub Vec<String>);

/// Reads `"A B"`.
pub fn names(text: &str) -> Result<Names, String> {
    let names: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
    if names.is_empty() { Err("it names no platform".to_owned()) } else { Ok(Names(names)) }
}

fn backend(text: &str) -> Result<(Option<String>, Backend), String> {
    match text.split_once('=') {
        Some((platform, kind)) => Ok((Some(platform.to_owned()), kind.parse()?)),
        None => Ok((None, text.parse()?)),
    }
}

fn of_platform(text: &str) -> Result<(String, PathBuf), String> {
    let (platform, file) = text.split_once('=').ok_or("it takes PLATFORM=FILE")?;
    Ok((platform.to_owned(), PathBuf::from(file)))
}

/// Carries out `whorl run`. The exit status is 0 when the verdict is that the experiment passed, 1 when it, a node or the
/// recording failed, 2 when nothing was started, and 130 when it was interrupted.
pub fn run(arguments: &Arguments) -> ExitCode {
    exit_code(try_run(arguments))
}

/// The exit status; an error means that nothing was started.
pub fn exit_code(result: anyhow::Result<u8>) -> ExitCode {
    result.map_or_else(
        |error| {
            tell(format_args!("error: {error:#}"));
            ExitCode::from(NOT_STARTED)
        },
        ExitCode::from,
    )
}

fn try_run(arguments: &Arguments) -> anyhow::Result<u8> {
    let folders = &arguments.folders;
    // Without a name, the error lists the existing experiments.
    let mut setup = Setup::new(options(arguments, arguments.experiment.as_deref().unwrap_or_default()))?;
    let domain = this_domain()?;
    use_emulators(&mut setup, &domain);
    let programs = Programs::beside_this_one()?;
    for process in setup.everything(Path::new(""), None) {
        programs.path(process.node)?;
    }
    let real_time = arguments.scheduling.real_time()?;
    let _lease = domain.take()?;
    let environment = if arguments.secure { security::environment(&setup.platforms)? } else { Vec::new() };
    let interrupted = Interrupted::new()?;
    let run = folders.new_run(arguments.out.as_deref(), &setup)?;
    domain.remember_supervisor(EXPERIMENT);

    let mut supervisor =
        Supervisor::new(domain.clone()).with_environment(environment.clone()).with_real_time(real_time);
    let mut started = Ok(());
    for process in setup.everything(&run, git_commit(&folders.root).as_deref()) {
        if started.is_ok() && !interrupted.yes() {
            started = supervisor.start(&programs, process, &run.join("logs"));
            if arguments.secure {
                std::thread::sleep(BETWEEN_SECURED);
            }
        }
    }
    let to_error = arguments.json.takes_standard_output();
    let mut page =
        arguments.live.then(|| LivePage::start(&setup.platforms, &run, arguments.live_port, to_error));
    let mut monitor =
        Monitor::start(setup.platforms.clone(), environment, arguments.json.takes_standard_output());
    let status = match started {
        Ok(()) => watch(&mut supervisor, Some(&mut monitor), &interrupted),
        Err(error) => {
            tell(format_args!("error: {error}"));
            1
        }
    };
    monitor.stop();
    // Before the programs end, so that nobody looks at a page that shows nothing.
    drop(page.take());
    let all_well = stop(&mut supervisor);
    let status = if status == 0 && !all_well { 1 } else { status };
    domain.forget_supervisor(EXPERIMENT);
    // The report is written even for a run that was ended early.
    let judged = if run.join("bag").is_dir() {
        report::write(&run, None)
    } else {
        Err(anyhow::anyhow!("{} holds no recording", run.display()))
    };
    Ok(match judged {
        Ok(report) => {
            report::print(&report);
            arguments.json.write(|| report::as_json(&run, &report))?;
            if status == 0 && report.verdict.failed() { 1 } else { status }
        }
        Err(error) => {
            tell(format_args!("error: {error:#}"));
            say("verdict: FAILED: there is no complete recording");
            if status == 0 { 1 } else { status }
        }
    })
}

/// Has drivers of devices find those that are emulated in this domain, and says which are real.
pub fn use_emulators(setup: &mut Setup, domain: &Domain) {
    for platform in setup.on_hardware() {
        match domain.emulated(&platform) {
            Some(root) => {
                say(format_args!("{platform}: its devices are EMULATED ({})", root.display()));
                setup.emulate(&platform, root);
            }
            None => say(format_args!("{platform}: its devices are real")),
        }
    }
}

const EXPERIMENT: &str = "experiment";

fn options(arguments: &Arguments, experiment: &str) -> SetupOptions {
    let mut options = arguments.folders.options(experiment);
    options.seed = arguments.seed;
    options.platforms = arguments.platforms.clone().map(|Names(names)| names);
    let mut drivers = BTreeMap::<String, DriverSource>::new();
    let mut of_all = Backend::default();
    for (platform, backend) in &arguments.backend {
        match platform {
            Some(platform) => drivers.entry(platform.clone()).or_default().backend = *backend,
            None => of_all = *backend,
        }
    }
    for (platform, file) in &arguments.source {
        drivers.entry(platform.clone()).or_default().source = Some(file.clone());
    }
    for (platform, file) in &arguments.channels {
        drivers.entry(platform.clone()).or_default().channels = Some(file.clone());
    }
    let named = |platform: &String| arguments.backend.iter().any(|(p, _)| p.as_ref() == Some(platform));
    for (_, driver) in drivers.iter_mut().filter(|(platform, _)| !named(platform)) {
        driver.backend = of_all;
    }
    options.drivers = drivers;
    options.backend_of_others = of_all;
    options
}

/// The domain that the environment chooses.
pub fn this_domain() -> anyhow::Result<Domain> {
    Ok(Domain::new(Network::from_environment()?.domain_id))
}

fn git_commit(root: &Path) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(root).args(["rev-parse", "HEAD"]).output().ok()?;
    let commit = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !commit.is_empty()).then_some(commit)
}

/// Watches the processes until one ends, the experiment is over or the user interrupts; returns the exit status.
pub fn watch(
    supervisor: &mut Supervisor,
    mut monitor: Option<&mut Monitor>,
    interrupted: &Interrupted,
) -> u8 {
    let mut until: Option<Instant> = None;
    loop {
        if interrupted.yes() {
            return INTERRUPTED;
        }
        match supervisor.ended() {
            // The coordinator at the end of the experiment, which the monitor is about to report, or a driver at the
            // end of its recording.
            Some(Ended { label, status, .. }) if status.success() => {
                say(format_args!("{label} has finished"));
                if monitor.is_none() {
                    return 0;
                }
                until.get_or_insert(Instant::now() + LAST_LOOK);
            }
            Some(ended) if ended.by_accident() && restarted(supervisor, &ended) => {}
            Some(ended) => {
                let Ended { label, status, log } = &ended;
                tell(format_args!(
                    "error: {label} ended with status {}. Its log, {}, says:\n{}",
                    shell_status(*status),
                    log.display(),
                    ended.last_words()
                ));
                return 1;
            }
            None => {}
        }
        if let Some(status) = monitor.as_mut().and_then(|monitor| monitor.status()) {
            return status;
        }
        if until.is_some_and(|until| Instant::now() >= until) {
            return 0;
        }
        std::thread::sleep(LOOK);
    }
}

/// Starts a node again that ended by accident, and says so; false when it cannot be.
fn restarted(supervisor: &mut Supervisor, ended: &Ended) -> bool {
    let Ended { label, status, log } = ended;
    let status = shell_status(*status);
    match supervisor.restart(label) {
        Ok(true) => {
            tell(format_args!(
                "warning: {label} ended with status {status} and was started again ({})",
                log.display()
            ));
            true
        }
        Ok(false) => false,
        Err(error) => {
            tell(format_args!(
                "error: {label} ended with status {status} and cannot be started again: {error}"
            ));
            false
        }
    }
}

/// Exit status as in a shell: 128 plus the signal's number for a process that a signal ended.
fn shell_status(status: ExitStatus) -> i32 {
    use std::os::unix::process::ExitStatusExt;
    status.code().or_else(|| status.signal().map(|signal| 128 + signal)).unwrap_or(1)
}

/// Stops everything and reports processes that had to be killed, or that say at their end that they failed, such as a
/// recorder whose disk was full. False when there is one that failed.
pub fn stop(supervisor: &mut Supervisor) -> bool {
    let stopped = supervisor.stop();
    for label in stopped.killed {
        tell(format_args!("warning: {label} did not stop, killed it"));
    }
    for ended in &stopped.failed {
        let Ended { label, status, .. } = ended;
        tell(format_args!(
            "error: {label} ended with status {}:\n{}",
            shell_status(*status),
            ended.last_words()
        ));
    }
    stopped.failed.is_empty()
}

/// Ctrl-C, SIGTERM or a closed terminal. Further signals have no effect: everything is already being stopped.
pub struct Interrupted(Arc<AtomicBool>);

impl Interrupted {
    /// From now on signals are only recorded.
    pub fn new() -> anyhow::Result<Self> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&flag)).context("cannot handle signals")?;
        }
        Ok(Self(flag))
    }

    /// Whether a signal has come.
    pub fn yes(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// How often a monitor that ended by accident is started again.
const MONITORS: u32 = 5;

/// The live status, in a process of its own: what reaches it over the network, and ends it, must not end the supervisor.
pub struct Monitor {
    platforms: Vec<String>,
    environment: Vec<(String, String)>,
    is_quiet: bool,
    child: Option<Child>,
    started: u32,
}

impl Monitor {
    fn start(platforms: Vec<String>, environment: Vec<(String, String)>, is_quiet: bool) -> Self {
        let mut monitor = Self { platforms, environment, is_quiet, child: None, started: 0 };
        monitor.spawn();
        monitor
    }

    /// Without a monitor an experiment runs all the same: its end is that of its coordinator.
    fn spawn(&mut self) {
        self.started += 1;
        let program = std::env::current_exe();
        let child = program.and_then(|program| {
            let mut command = Command::new(program);
            // Ctrl-C is for the supervisor.
            command.envs(self.environment.iter().cloned());
            command.arg("monitor").args(&self.platforms).arg("--to-the-end");
            if self.is_quiet {
                command.stdout(Stdio::null());
            }
            command.stdin(Stdio::null()).process_group(0).spawn()
        });
        match child {
            Ok(child) => self.child = Some(child),
            Err(error) => tell(format_args!("warning: there is no live status: {error}")),
        }
    }

    /// The resulting exit status, once the monitor has ended.
    fn status(&mut self) -> Option<u8> {
        let status = self.child.as_mut()?.try_wait().ok().flatten()?;
        self.child = None;
        if let Some(code) = status.code() {
            return Some(u8::from(code != 0));
        }
        if self.started < MONITORS {
            tell(format_args!(
                "warning: the monitor ended with status {} and was started again",
                shell_status(status)
            ));
            self.spawn();
        }
        None
    }

    fn stop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The page in the browser, in a process of its own: whatever happens to it, the experiment goes on.
struct LivePage(Option<Child>);

impl LivePage {
    fn start(platforms: &[String], run: &Path, port: u16, to_error: bool) -> Self {
        let child = std::env::current_exe().and_then(|program| {
            let mut command = Command::new(program);
            command.arg("live").args(platforms).arg("--run").arg(run).args(["--port", &port.to_string()]);
            if to_error {
                // Its address.
                command.stdout(std::io::stderr());
            }
            // Ctrl-C is for the supervisor.
            command.stdin(Stdio::null()).process_group(0).spawn()
        });
        if let Err(error) = &child {
            tell(format_args!("warning: there is no live page: {error}"));
        }
        Self(child.ok())
    }
}

impl Drop for LivePage {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Prints to the standard output; a closed output is ignored, since the processes must still be watched.
pub fn say(text: impl Display) {
    crate::output::line(format_args!("{text}"));
}

/// Prints to the standard error, likewise.
pub fn tell(text: impl Display) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
