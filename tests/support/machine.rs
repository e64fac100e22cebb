//! Tests share the machine: so many at a time that it is busy, and not so many that they only wait for each other.

use std::sync::{Condvar, Mutex, Once, PoisonError};

use rustix::process::{Pid, setpriority_process};
use whorl_tests::skipped;

/// How much of the machine a test needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Load {
    /// The nodes of one platform in real time, or fewer.
    Light,
    /// A formation of two platforms in real time: less than half a core.
    Formation,
    /// A load that computes all the time.
    Computation,
    /// A platform beside emulators of its devices, in real time: about a core, as measured.
    Emulation,
    /// A formation and a browser that draws it without a graphics card.
    Browser,
}

/// A share of the machine, given back on drop.
pub struct Share(u32);

static FREE: Mutex<Option<u32>> = Mutex::new(None);
static CHANGED: Condvar = Condvar::new();

impl Load {
    /// Waits for that share.
    pub fn take(self) -> Share {
        let units = match self {
            Self::Light | Self::Formation => 1,
            Self::Computation | Self::Emulation | Self::Browser => 2,
        };
        let mut free = FREE.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let now = *free.get_or_insert_with(capacity);
            if now >= units {
                *free = Some(now - units);
                return Share(units);
            }
            free = CHANGED.wait(free).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Two units per core.
fn capacity() -> u32 {
    std::thread::available_parallelism().map_or(2, |n| u32::try_from(2 * n.get()).unwrap_or(2))
}

/// Lets a process (`None`: this thread, and those that it starts) run ahead of whatever else keeps the machine busy, as on a
/// computer of its own. That makes tests quicker; none of them depends on it. Without the right to do so it runs as it is, which
/// is said once.
pub fn prefer(process: Option<Pid>) {
    static SAID: Once = Once::new();
    if let Err(error) = setpriority_process(process, -15) {
        SAID.call_once(|| skipped("a higher priority of the processes under test", &error.to_string()));
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut free = FREE.lock().unwrap_or_else(PoisonError::into_inner);
        *free = Some(free.unwrap_or(0) + self.0);
        CHANGED.notify_all();
    }
}
