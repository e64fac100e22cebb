//! Tests share the machine: what runs in real time must not be starved by its neighbours.

use std::sync::{Condvar, Mutex, PoisonError};

use rustix::process::{Pid, setpriority_process};

/// How much of the machine a test needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Load {
    /// The nodes of one platform in real time, or fewer.
    Light,
    /// A load that computes all the time.
    Computation,
    /// A formation of two platforms in real time.
    Formation,
    /// A platform beside emulators of its devices, in real time: about a core, as measured.
    Emulation,
    /// A formation and a browser that draws it without a graphics card: whatever there is.
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
            Self::Light => 1,
            Self::Computation | Self::Formation | Self::Emulation => 2,
            Self::Browser => capacity(),
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

/// Two units per core: a formation of two platforms needs less than half of one.
fn capacity() -> u32 {
    std::thread::available_parallelism().map_or(2, |n| u32::try_from(2 * n.get()).unwrap_or(2))
}

/// Lets a process (`None`: this thread, and those that it starts) run ahead of whatever else keeps the
/// machine busy, as on a computer of its own. Without the right to do so it runs as it is.
pub fn prefer(process: Option<Pid>) {
    let _ = setpriority_process(process, -15);
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut free = FREE.lock().unwrap_or_else(PoisonError::into_inner);
        *free = Some(free.unwrap_or(0) + self.0);
        CHANGED.notify_all();
    }
}
