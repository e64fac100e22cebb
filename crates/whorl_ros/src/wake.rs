//! Wake-ups of the event loop besides messages: a precise timer, and signals. Linux only.

use std::io::Read;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use mio::net::UnixStream;
use mio::unix::SourceFd;
use mio::{Interest, Registry, Token};
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create, timerfd_settime,
};
use signal_hook::consts::{SIGCONT, SIGINT, SIGTERM};

use crate::clock::monotonic;
use crate::error::RosError;

/// A one-shot alarm on the monotonic clock. `mio::Poll`'s own timeout has a resolution of 1 ms.
#[derive(Debug)]
pub(crate) struct Alarm {
    timer: OwnedFd,
    set_to: Option<Duration>,
}

impl Alarm {
    pub(crate) fn new(registry: &Registry, token: Token) -> Result<Self, RosError> {
        let timer = timerfd_create(TimerfdClockId::Monotonic, TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC)
            .map_err(|e| RosError::io("creating a timer")(e.into()))?;
        registry
            .register(&mut SourceFd(&timer.as_raw_fd()), token, Interest::READABLE)
            .map_err(RosError::io("watching a timer"))?;
        Ok(Self { timer, set_to: None })
    }

    /// Rings once at a monotonic time, at once if that is past.
    pub(crate) fn set(&mut self, at: Duration) -> Result<(), RosError> {
        if self.set_to == Some(at) && at > monotonic() {
            return Ok(());
        }
        self.set_to = Some(at);
        let it_value = Timespec {
            tv_sec: i64::try_from(at.as_secs()).unwrap_or(i64::MAX),
            // Zero in both fields would switch the timer off.
            tv_nsec: i64::from(at.subsec_nanos().max(1)),
        };
        let it_interval = Timespec { tv_sec: 0, tv_nsec: 0 };
        timerfd_settime(self.timer.as_fd(), TimerfdTimerFlags::ABSTIME, &Itimerspec { it_interval, it_value })
            .map(|_| ())
            .map_err(|e| RosError::io("setting a timer")(e.into()))
    }
}

/// Signals that end a node.
pub(crate) const END: &[i32] = &[SIGINT, SIGTERM];
/// Signals that tell a node that it had been stopped.
pub(crate) const CONTINUE: &[i32] = &[SIGCONT];

/// Tells whether this process was stopped and continued: that ends the background threads of RustDDS. For programs without
/// an event loop of this crate.
#[derive(Debug)]
pub struct Continued(Arc<AtomicBool>);

impl Continued {
    /// From now on.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn watch() -> Result<Self, RosError> {
        let flag = Arc::new(AtomicBool::new(false));
        for &signal in CONTINUE {
            signal_hook::flag::register(signal, Arc::clone(&flag))
                .map_err(RosError::io("watching for signals"))?;
        }
        Ok(Self(flag))
    }

    /// Whether it was since the last call.
    #[must_use]
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

/// Signals as events.
#[derive(Debug)]
pub(crate) struct Signals {
    receiver: UnixStream,
}

impl Signals {
    pub(crate) fn new(registry: &Registry, token: Token, signals: &[i32]) -> Result<Self, RosError> {
        let error = || RosError::io("watching for signals");
        let (mut receiver, sender) = UnixStream::pair().map_err(error())?;
        for &signal in signals {
            let sender = sender.as_fd().try_clone_to_owned().map_err(error())?;
            signal_hook::low_level::pipe::register(signal, sender).map_err(error())?;
        }
        registry.register(&mut receiver, token, Interest::READABLE).map_err(error())?;
        Ok(Self { receiver })
    }

    /// Whether one of them came since the last call.
    pub(crate) fn received(&mut self) -> bool {
        let mut buffer = [0; 16];
        matches!(self.receiver.read(&mut buffer), Ok(1..))
    }
}
