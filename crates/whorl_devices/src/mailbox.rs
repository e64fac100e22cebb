//! Commands to a device's thread.

use std::cell::Cell;
use std::io::{Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use whorl_dynamics::actuators::Kind;

/// A device's thread switches everything off when it has not heard of the node for so long. The node's own gate is quicker;
/// this one acts when the node's thread hangs.
const NODE_SILENT: Duration = Duration::from_millis(200);

/// What devices are asked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// The node runs; it says so at every tick.
    Alive,
    /// Commands of every motor of one kind of actuator, in the kind's unit.
    Motors(Kind, Arc<[f64]>),
    /// Opens each jet's valve for so long from that instant on \[s\], and closes all others.
    Pulses(Instant, Arc<[f64]>),
    /// All valves closed, all motor commands zero.
    AllOff,
}

/// The sending end.
#[derive(Debug)]
pub(crate) struct Letters {
    sender: Sender<Command>,
    wake: UnixStream,
}

impl Letters {
    pub(crate) fn send(&self, command: Command) {
        let urgent = command != Command::Alive;
        if self.sender.send(command).is_ok() && urgent {
            let _ = (&self.wake).write(&[1]);
        }
    }
}

/// The receiving end, in a device's thread.
#[derive(Debug)]
pub struct Mailbox {
    receiver: Receiver<Command>,
    wake: UnixStream,
    heard: Cell<Instant>,
    /// Whether everything was switched off because the node was not heard of.
    asleep: Cell<bool>,
    closed: Cell<bool>,
}

/// What ended a wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Woken {
    /// The device has bytes for us, or is gone.
    pub device: bool,
}

impl Mailbox {
    pub(crate) fn new() -> std::io::Result<(Letters, Self)> {
        let (sender, receiver) = channel();
        let (wake, ours) = UnixStream::pair()?;
        wake.set_nonblocking(true)?;
        ours.set_nonblocking(true)?;
        let heard = Cell::new(Instant::now());
        let mailbox =
            Self { receiver, wake: ours, heard, asleep: Cell::new(false), closed: Cell::new(false) };
        Ok((Letters { sender, wake }, mailbox))
    }

    /// Waits until there is a command, the device has bytes, or `until` has come.
    pub fn wait(&self, device: Option<BorrowedFd<'_>>, until: Instant) -> Woken {
        let until = until.min((self.heard.get() + NODE_SILENT).max(Instant::now() + TICK));
        let left = until.saturating_duration_since(Instant::now());
        let timeout = Timespec {
            tv_sec: i64::try_from(left.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: i64::from(left.subsec_nanos()),
        };
        let mut fds = vec![PollFd::from_borrowed_fd(self.wake.as_fd(), PollFlags::IN)];
        fds.extend(device.map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)));
        // An interrupted wait is a short one.
        let _ = poll(&mut fds, Some(&timeout));
        if fds.first().is_some_and(|fd| !fd.revents().is_empty()) {
            let _ = (&self.wake).read(&mut [0; 64]);
        }
        Woken { device: fds.get(1).is_some_and(|fd| !fd.revents().is_empty()) }
    }

    /// The next command. When the node was not heard of for too long, that is once [`Command::AllOff`].
    pub fn take(&self) -> Option<Command> {
        loop {
            match self.receiver.try_recv() {
                Ok(command) => {
                    self.heard.set(Instant::now());
                    self.asleep.set(false);
                    if command != Command::Alive {
                        return Some(command);
                    }
                }
                Err(TryRecvError::Disconnected) => {
                    self.closed.set(true);
                    return None;
                }
                Err(TryRecvError::Empty) if self.heard.get().elapsed() < NODE_SILENT => return None,
                Err(TryRecvError::Empty) if self.asleep.replace(true) => return None,
                Err(TryRecvError::Empty) => return Some(Command::AllOff),
            }
        }
    }

    /// Whether the node has ended. Known once [`Self::take`] has given everything.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closed.get()
    }

    /// Waits, forgetting commands: what was asked of a device that was not there is out of date when it comes.
    pub(crate) fn idle(&self, length: Duration) {
        let until = Instant::now() + length;
        while Instant::now() < until && !self.is_closed() {
            self.wait(None, until);
            while self.take().is_some() {}
        }
    }
}

const TICK: Duration = Duration::from_millis(20);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_that_is_not_heard_of_has_everything_switched_off_once() {
        let (letters, mailbox) = Mailbox::new().unwrap();
        letters.send(Command::Motors(Kind::Wheels, Arc::new([1.0])));
        assert!(matches!(mailbox.take(), Some(Command::Motors(..))));
        let began = Instant::now();
        let far = began + Duration::from_secs(5);
        let off = loop {
            mailbox.wait(None, far);
            if let Some(command) = mailbox.take() {
                break command;
            }
        };
        assert_eq!(off, Command::AllOff);
        // Not before its time; how long after it is the computer's.
        let after = began.elapsed();
        assert!(after > NODE_SILENT - TICK, "{after:?}");
        assert_eq!(mailbox.take(), None);
        letters.send(Command::Alive);
        assert_eq!(mailbox.take(), None);
        assert!(!mailbox.is_closed());
        drop(letters);
        assert_eq!(mailbox.take(), None);
        assert!(mailbox.is_closed());
    }
}
