//! What was started by a launcher ends with it, also when the launcher is killed.

use std::io::Read;
use std::time::Duration;

use rustix::process::{Signal, getpid, kill_process};

/// Set by the launcher (`whorl_launch`): the standard input is a pipe that it holds open while it runs.
const VARIABLE: &str = "WHORL_ENDS_WITH_INPUT";
/// Time to end in order, as the launcher gives a recorder.
const TO_END: Duration = Duration::from_secs(5);

/// Ends this process, as if it were asked to, when its launcher ends: with the standard input. Does nothing for a process that
/// nobody launched.
pub fn end_with_launcher() {
    if std::env::var_os(VARIABLE).is_none() {
        return;
    }
    let watch = || {
        let mut input = std::io::stdin().lock();
        let mut bytes = [0; 64];
        // Nobody writes to it; an error is no end.
        loop {
            match input.read(&mut bytes) {
                Ok(0) => break,
                Ok(_) => {}
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(_) => return,
            }
        }
        tracing::warn!("the launcher has ended: so does this process");
        let _ = kill_process(getpid(), Signal::TERM);
        std::thread::sleep(TO_END);
        let _ = kill_process(getpid(), Signal::KILL);
    };
    if let Err(error) = std::thread::Builder::new().name("launcher".to_owned()).spawn(watch) {
        tracing::warn!("this process will not end with its launcher: {error}");
    }
}
