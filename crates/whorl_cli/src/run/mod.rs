//! `whorl run`: an experiment over DDS on this machine, from start to report, with a process for every node.

mod arguments;
mod exit_status;
mod screens;
mod watch;

use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Duration;

use whorl_launch::{Domain, Programs, Setup, Supervisor};
use whorl_ros::environment::Network;

pub use arguments::{AboutPlatform, Arguments, Folders, Names, Scheduling, names};
use screens::{Screen, Surroundings, Words};
pub use watch::{INTERRUPTED, Interrupted, stop, watch};

use crate::output::{say, tell};
use crate::{report, security};

/// Exit status when nothing was started.
const NOT_STARTED: u8 = 2;
/// Time between the starts of two secured nodes: each exchanges keys with all that are there already.
const BETWEEN_SECURED: Duration = Duration::from_millis(300);

const EXPERIMENT: &str = "experiment";

/// Carries out `whorl run`. The exit status is 0 when the verdict is that the experiment passed, 1 when it, a node or the
/// recording failed, 2 when nothing was started, and 130 when it was interrupted.
pub fn run(arguments: &Arguments) -> ExitCode {
    exit_code(try_run(arguments))
}

/// The exit status; an error means that nothing was started.
pub fn exit_code(result: anyhow::Result<u8>) -> ExitCode {
    result.map_or_else(
        |error| {
            tell(format_args!("error: {}", whorl_commands::in_words(&error)));
            ExitCode::from(NOT_STARTED)
        },
        ExitCode::from,
    )
}

fn try_run(arguments: &Arguments) -> anyhow::Result<u8> {
    let folders = &arguments.folders;
    // Without a name, the error lists the existing experiments.
    let mut setup = Setup::new(arguments.options(arguments.experiment.as_deref().unwrap_or_default()))?;
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
    let surroundings =
        Surroundings { platforms: &setup.platforms, environment: &environment, domain: &domain };
    let is_for_programs = arguments.json.takes_standard_output();
    let of = |where_else| if is_for_programs { where_else } else { Words::Output };
    let mut page =
        arguments.live.then(|| Screen::live_page(&surroundings, &run, arguments.live_port, of(Words::Error)));
    let mut monitor = Screen::monitor(&surroundings, of(Words::Nowhere));
    let status = match started {
        Ok(()) => watch(&mut supervisor, Some(&mut monitor), page.as_mut(), &interrupted),
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
            // Before the verdict, which is the last line.
            if let Some(advice) = report.verdict.advice() {
                tell(format_args!("advice: {advice}"));
            }
            report::print(&report);
            arguments.json.write(|| report::as_json(&run, &report))?;
            if status == 0 && report.verdict.failed() { 1 } else { status }
        }
        Err(error) => {
            tell(format_args!("error: {}", whorl_commands::in_words(&error)));
            say!("verdict: FAILED: there is no complete recording");
            if status == 0 { 1 } else { status }
        }
    })
}

/// Has drivers of devices find those that are emulated in this domain, and says which are real.
pub fn use_emulators(setup: &mut Setup, domain: &Domain) {
    for platform in setup.on_hardware() {
        match domain.emulated(&platform) {
            Some(root) => {
                say!("{platform}: its devices are EMULATED ({})", root.display());
                setup.emulate(&platform, root);
            }
            None => say!("{platform}: its devices are real"),
        }
    }
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
