//! Another computer's clock: a library that processes load first and that shifts their time of day.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The monotonic clocks are unchanged: an offset of theirs is not observable.
const SOURCE: &str = r#"
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t id, struct timespec *t)
{
    int status = (int)syscall(SYS_clock_gettime, id, t);
    const char *shift = getenv("WHORL_TEST_CLOCK_SHIFT_NS");
    if (status == 0 && id == CLOCK_REALTIME && shift) {
        long long ns = t->tv_sec * 1000000000LL + t->tv_nsec + atoll(shift);
        t->tv_sec = ns / 1000000000LL;
        t->tv_nsec = ns % 1000000000LL;
    }
    return status;
}
"#;

/// Variables for processes whose clock is to be ahead by this [s]. `Err`: why this machine cannot.
pub fn shifted(folder: &Path, ahead_s: f64) -> Result<Vec<(String, String)>, String> {
    let library: PathBuf = folder.join("libshiftedclock.so");
    if !library.exists() {
        let source = folder.join("shifted_clock.c");
        std::fs::write(&source, SOURCE).map_err(|e| e.to_string())?;
        let output = Command::new("cc")
            .args(["-shared", "-fPIC", "-O2", "-o"])
            .args([&library, &source])
            .output()
            .map_err(|e| format!("cannot run cc: {e}"))?;
        if !output.status.success() {
            return Err(String::from_utf8_lossy(&output.stderr).into_owned());
        }
    }
    Ok(vec![
        ("LD_PRELOAD".into(), library.to_string_lossy().into_owned()),
        ("WHORL_TEST_CLOCK_SHIFT_NS".into(), format!("{:.0}", ahead_s * 1e9)),
    ])
}
