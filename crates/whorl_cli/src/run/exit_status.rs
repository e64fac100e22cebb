//! How a process ended, in a number.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

/// Exit status as in a shell: 128 plus the signal's number for a process that a signal ended.
pub(super) fn shell_status(status: ExitStatus) -> i32 {
    status.code().or_else(|| status.signal().map(|signal| 128 + signal)).unwrap_or(1)
}
