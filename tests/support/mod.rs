//! Helpers of the tests: binaries, processes, domains, an observer on the network, simulations.

pub mod binaries;
pub mod browser;
pub mod clock;
pub mod cores;
pub mod formation;
pub mod machine;
pub mod network;
pub mod process;
pub mod relay;
pub mod simulation;
pub mod typed;
pub mod watch;

use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

pub use whorl_tests::skipped;

/// The folder of the workspace.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// Whether this machine allows network namespaces and mounts.
pub fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

/// Prints a measured number, also when the test passes.
pub fn measured(text: &str) {
    let _ = writeln!(std::io::stderr(), "\n    measured: {text}");
}

/// Retries until there is a result, at most for `timeout`.
pub fn wait_for<T>(what: &str, timeout: Duration, mut attempt: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(value) = attempt() {
            return value;
        }
        assert!(begin.elapsed() < timeout, "waited {timeout:?} for {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}
