//! What a user looks at while an experiment runs: the monitor in the terminal, the page in the browser.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use super::exit_status::shell_status;
use crate::output::tell;

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
    pub(super) fn start(platforms: Vec<String>, environment: Vec<(String, String)>, is_quiet: bool) -> Self {
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
    pub(super) fn status(&mut self) -> Option<u8> {
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

    pub(super) fn stop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The page in the browser, in a process of its own: whatever happens to it, the experiment goes on.
pub(super) struct LivePage(Option<Child>);

impl LivePage {
    pub(super) fn start(platforms: &[String], run: &Path, port: u16, to_error: bool) -> Self {
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
