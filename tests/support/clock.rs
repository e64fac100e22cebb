//! Another computer's clock, and one that is set while processes run: a library that they load first and that shifts their
//! time of day.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The monotonic clocks are unchanged: an offset of theirs is not observable.
const SOURCE: &str = r#"
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static volatile long long *shared;

__attribute__((constructor)) static void begin(void)
{
    const char *path = getenv("WHORL_TEST_CLOCK_SHIFT_FILE");
    int file = path ? open(path, O_RDONLY) : -1;
    if (file >= 0) {
        void *at = mmap(0, sizeof *shared, PROT_READ, MAP_SHARED, file, 0);
        shared = at == MAP_FAILED ? 0 : at;
        close(file);
    }
}

int clock_gettime(clockid_t id, struct timespec *t)
{
    int status = (int)syscall(SYS_clock_gettime, id, t);
    const char *shift = getenv("WHORL_TEST_CLOCK_SHIFT_NS");
    if (status == 0 && id == CLOCK_REALTIME && (shift || shared)) {
        long long by = (shift ? atoll(shift) : 0) + (shared ? *shared : 0);
        long long ns = t->tv_sec * 1000000000LL + t->tv_nsec + by;
        t->tv_sec = ns / 1000000000LL;
        t->tv_nsec = ns % 1000000000LL;
    }
    return status;
}
"#;

/// Variables for processes whose clock is to be ahead by this [s]. `Err`: why this machine cannot.
pub fn shifted(folder: &Path, ahead_s: f64) -> Result<Vec<(String, String)>, String> {
    let library = library(folder)?;
    Ok(vec![
        ("LD_PRELOAD".into(), library.to_string_lossy().into_owned()),
        ("WHORL_TEST_CLOCK_SHIFT_NS".into(), format!("{:.0}", ahead_s * 1e9)),
    ])
}

/// A clock of processes that can be set while they run.
pub struct Settable(File);

impl Settable {
    /// The clock, right at first, and variables for the processes. `Err`: why this machine cannot.
    pub fn new(folder: &Path) -> Result<(Self, Vec<(String, String)>), String> {
        let library = library(folder)?;
        let path = folder.join("clock_shift");
        std::fs::write(&path, 0_i64.to_ne_bytes()).map_err(|e| e.to_string())?;
        let file = File::options().write(true).open(&path).map_err(|e| e.to_string())?;
        let variables = vec![
            ("LD_PRELOAD".into(), library.to_string_lossy().into_owned()),
            ("WHORL_TEST_CLOCK_SHIFT_FILE".into(), path.to_string_lossy().into_owned()),
        ];
        Ok((Self(file), variables))
    }

    /// Sets it ahead of the computer's by this [s].
    pub fn set_ahead(&self, ahead_s: f64) {
        let ahead_ns = (ahead_s * 1e9) as i64;
        self.0.write_all_at(&ahead_ns.to_ne_bytes(), 0).unwrap();
    }
}

fn library(folder: &Path) -> Result<PathBuf, String> {
    let library = folder.join("libshiftedclock.so");
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
    Ok(library)
}
