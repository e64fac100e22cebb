//! A serial port.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::termios::{OptionalActions, isatty, tcgetattr, tcsetattr};

use crate::DeviceError;

/// A port that takes no bytes for so long is stuck.
const STUCK: Duration = Duration::from_millis(100);

/// An open serial port: 8 data bits, no parity, 1 stop bit, no flow control, nothing translated.
#[derive(Debug)]
pub struct Serial {
    port: File,
    address: String,
}

impl Serial {
    /// Opens it at a rate in bits a second.
    ///
    /// # Errors
    /// No such port, no permission, not a serial port, a rate that it does not have.
    pub fn open(path: &Path, baud: u32) -> Result<Self, DeviceError> {
        let address = path.display().to_string();
        let io = DeviceError::io::<rustix::io::Errno>;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = open(path, flags, Mode::empty()).map_err(io("cannot open", &address))?;
        if !isatty(&port) {
            return Err(DeviceError::Refused(format!("{address} is not a serial port")));
        }
        let mut settings = tcgetattr(&port).map_err(io("cannot set", &address))?;
        settings.make_raw();
        settings.set_speed(baud).map_err(io("cannot set the rate of", &address))?;
        // Now, and without what was received before.
        tcsetattr(&port, OptionalActions::Flush, &settings).map_err(io("cannot set", &address))?;
        Ok(Self { port: File::from(port), address })
    }

    /// For waiting until it has bytes.
    #[must_use]
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.port.as_fd()
    }

    /// Everything that has arrived; waits for nothing.
    ///
    /// # Errors
    /// The port is gone.
    pub fn read(&mut self, into: &mut Vec<u8>) -> Result<usize, DeviceError> {
        let mut buffer = [0; 1024];
        let mut total = 0;
        loop {
            match self.port.read(&mut buffer) {
                Ok(0) if total > 0 => return Ok(total),
                // The other end was closed.
                Ok(0) => return Err(self.lost(ErrorKind::UnexpectedEof.into())),
                Ok(count) => {
                    total += count;
                    into.extend_from_slice(buffer.get(..count).unwrap_or_default());
                    if count < buffer.len() {
                        return Ok(total);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(total),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
    }

    /// Sends all bytes.
    ///
    /// # Errors
    /// The port is gone, or takes nothing for 0.1 s.
    pub fn write(&mut self, mut bytes: &[u8]) -> Result<(), DeviceError> {
        let began = Instant::now();
        while !bytes.is_empty() {
            match self.port.write(bytes) {
                Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
                Err(error) if error.kind() == ErrorKind::WouldBlock && began.elapsed() < STUCK => {
                    let wait = Timespec { tv_sec: 0, tv_nsec: 1_000_000 };
                    let _ =
                        poll(&mut [PollFd::from_borrowed_fd(self.port.as_fd(), PollFlags::OUT)], Some(&wait));
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
        Ok(())
    }

    fn lost(&self, error: std::io::Error) -> DeviceError {
        DeviceError::io("lost", &self.address)(error)
    }
}
