//! Nodes while they run, and their end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use whorl_launch::{Ended, Supervisor};

use super::exit_status::shell_status;
use super::screens::Screen;
use crate::output::{say, tell};

/// Exit status after Ctrl-C, as shells give it.
pub const INTERRUPTED: u8 = 130;
/// Interval at which the processes are polled.
const LOOK: Duration = Duration::from_millis(100);
/// Time that the monitor has to report the end of an experiment after the first node has finished.
const LAST_LOOK: Duration = Duration::from_secs(2);

/// Watches the processes until one ends, the experiment is over or the user interrupts; returns the exit status.
pub fn watch(
    supervisor: &mut Supervisor,
    mut monitor: Option<&mut Screen>,
    mut page: Option<&mut Screen>,
    interrupted: &Interrupted,
) -> u8 {
    let mut until: Option<Instant> = None;
    loop {
        if interrupted.yes() {
            return INTERRUPTED;
        }
        for (label, started) in supervisor.start_due() {
            match started {
                Ok(()) => tell(format_args!("warning: {label} was started again")),
                Err(error) => {
                    tell(format_args!("error: {label} cannot be started again: {error}"));
                    return 1;
                }
            }
        }
        match supervisor.ended() {
            // The coordinator at the end of the experiment, which the monitor is about to report, or a driver at the
            // end of its recording.
            Some(Ended { label, status, .. }) if status.success() => {
                say!("{label} has finished");
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
        if let Some(status) = page.as_mut().and_then(|page| page.look_after()) {
            tell(format_args!("warning: the live page has ended with status {status}"));
        }
        if let Some(status) = monitor.as_mut().and_then(|monitor| monitor.look_after()) {
            return u8::from(status != 0);
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
        Ok(Some(wait)) => {
            let again = match wait.as_secs() {
                0 => "was started again".to_owned(),
                wait_s => format!("is started again in {wait_s} s, as it ended often"),
            };
            tell(format_args!("warning: {label} ended with status {status} and {again} ({})", log.display()));
            true
        }
        Ok(None) => false,
        Err(error) => {
            tell(format_args!(
                "error: {label} ended with status {status} and cannot be started again: {error}"
            ));
            false
        }
    }
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
