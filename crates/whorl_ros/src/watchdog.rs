//! Ends a process whose event loop has stopped for good.
//!
//! A call into DDS may never return (docs/upstream, "wait for each other for ever"). What is known to do so runs on a thread of
//! its own, see `worker.rs`; this is for the rest. A node that hangs helps nobody: it does not even end when it is asked to.
//! One that has ended by a signal is started again by its launcher, at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use crate::error::RosError;
use crate::log;

/// How often the watchdog looks. It counts its looks, so that time in which the process is stopped or gets no processor does not
/// count.
const LOOK: Duration = Duration::from_secs(1);
/// So many looks without a turn are a hang. The loop turns every 0.1 s; its longest wait is for a table of DDS, 4 s.
const LOOKS: u32 = 15;

/// Watches a loop until it is dropped.
#[derive(Debug)]
pub(crate) struct Watchdog(Arc<Seen>);

#[derive(Debug, Default)]
struct Seen {
    turns: AtomicU64,
    waits: AtomicBool,
    end: AtomicBool,
}

impl Watchdog {
    /// Ends the process of the node with this name when its loop hangs.
    ///
    /// # Errors
    /// When no thread can be started.
    pub(crate) fn start(name: String) -> Result<Self, RosError> {
        let hang = move || {
            let hung_s = LOOKS * u32::try_from(LOOK.as_secs()).unwrap_or(1);
            log::complain(
                &name,
                &format!("its event loop has hung for {hung_s} s: the process ends, to be started again"),
            );
            std::process::abort();
        };
        Self::watch(LOOK, hang).map_err(RosError::io("starting a thread"))
    }

    fn watch(look: Duration, hang: impl FnOnce() + Send + 'static) -> std::io::Result<Self> {
        let seen = Arc::new(Seen::default());
        let watched = Arc::clone(&seen);
        std::thread::Builder::new().name("watchdog".into()).spawn(move || {
            let (mut before, mut still) = (0, 0);
            while !watched.end.load(Ordering::Relaxed) {
                std::thread::sleep(look);
                let turns = watched.turns.load(Ordering::Relaxed);
                let moves = turns != before || watched.waits.load(Ordering::Relaxed);
                still = if moves { 0 } else { still + 1 };
                before = turns;
                if still >= LOOKS && !watched.end.load(Ordering::Relaxed) {
                    return hang();
                }
            }
        })?;
        Ok(Self(seen))
    }

    /// The loop has turned.
    pub(crate) fn turn(&self) {
        self.0.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Whether the loop now does something that takes long, and has limits of its own: joining the network.
    pub(crate) fn waits(&self, waits: bool) {
        self.0.waits.store(waits, Ordering::Relaxed);
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.0.end.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    const QUICK: Duration = Duration::from_millis(2);

    #[test]
    fn a_loop_that_stops_is_noticed() {
        let (hung, told) = channel();
        let _watchdog = Watchdog::watch(QUICK, move || hung.send(()).unwrap()).unwrap();
        told.recv_timeout(Duration::from_secs(60)).unwrap();
    }

    #[test]
    fn one_that_waits_or_has_ended_is_left_alone() {
        let (hung, told) = channel();
        let watchdog = Watchdog::watch(QUICK, move || hung.send(()).unwrap()).unwrap();
        watchdog.waits(true);
        std::thread::sleep(QUICK * LOOKS * 4);
        drop(watchdog);
        // The thread ends without a word, which closes its end.
        assert!(told.recv().is_err());
    }
}
