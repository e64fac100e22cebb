//! A command that is one step of another.

use std::process::{Command, ExitStatus};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

use crate::error::LaunchError;

/// Interval at which the command is polled.
const LOOK: Duration = Duration::from_millis(50);

/// Runs a command to its end. When `stop` says so it is asked to end, and has all the time that it needs for that:
/// `whorl run` ends its nodes and closes the recording. `None`: it was stopped.
///
/// # Errors
/// When it cannot be started.
pub fn run_to_end(command: &mut Command, stop: impl Fn() -> bool) -> Result<Option<ExitStatus>, LaunchError> {
    let program = command.get_program().to_owned();
    let io = |what| LaunchError::io(what, program.clone());
    let mut child = command.spawn().map_err(io("cannot start"))?;
    loop {
        if stop() {
            if let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
                let _ = kill_process(pid, Signal::TERM);
            }
            child.wait().map_err(io("cannot wait for"))?;
            return Ok(None);
        }
        if let Some(status) = child.try_wait().map_err(io("cannot wait for"))? {
            return Ok(Some(status));
        }
        std::thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_ends_by_itself_or_when_it_is_asked_to() {
        let shell = |script: &str| {
            let mut command = Command::new("sh");
            command.args(["-c", script]);
            command
        };
        let status = run_to_end(&mut shell("exit 3"), || false).unwrap();
        assert_eq!(status.and_then(|status| status.code()), Some(3));
        // It would last for an hour.
        assert!(
            run_to_end(shell("exec sleep 3600").stdin(std::process::Stdio::null()), || true)
                .unwrap()
                .is_none()
        );
        let missing = run_to_end(&mut Command::new("/no/such/program"), || false).unwrap_err().to_string();
        assert!(missing.contains("/no/such/program"), "{missing}");
    }
}
