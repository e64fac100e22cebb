//! Devices at work: a thread each.

use std::cell::Cell;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::device::NamedDevice;
use crate::list::DeviceList;
use crate::mailbox::{Command, Letters, Mailbox};
use crate::place::Place;
use crate::reading::{Reading, Reporter, State};

/// Between a device's loss and the next attempt.
const AGAIN: Duration = Duration::from_millis(200);

/// The devices of a platform at work. They switch off and end when this is dropped.
#[derive(Debug)]
pub struct Devices {
    readings: Receiver<Reading>,
    woken: UnixStream,
    letters: Vec<Letters>,
    threads: Vec<JoinHandle<()>>,
}

impl Devices {
    /// Starts them. They connect by themselves.
    ///
    /// # Errors
    /// When the operating system gives no thread or no pipe.
    pub fn start(list: &DeviceList, place: &Place) -> std::io::Result<Self> {
        let (sender, readings) = channel();
        let (woken, wake) = UnixStream::pair()?;
        woken.set_nonblocking(true)?;
        wake.set_nonblocking(true)?;
        let bus_voltage_v = Arc::new(AtomicU64::new(f64::NAN.to_bits()));
        let mut devices = Self { readings, woken, letters: Vec::new(), threads: Vec::new() };
        for (index, named) in list.devices.iter().enumerate() {
            let (letters, mailbox) = Mailbox::new()?;
            let reporter = Reporter {
                device: index,
                readings: sender.clone(),
                wake: wake.try_clone()?,
                bus_voltage_v: Arc::clone(&bus_voltage_v),
                took_up: Cell::new(false),
            };
            let (named, place) = (named.clone(), place.clone());
            let thread = std::thread::Builder::new().name(named.name.clone());
            devices.threads.push(thread.spawn(move || keep(&named, &place, &mailbox, &reporter))?);
            devices.letters.push(letters);
        }
        Ok(devices)
    }

    /// A stream that becomes readable when the control loop should look at [`Self::next_reading`] at once.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn waker(&self) -> std::io::Result<UnixStream> {
        self.woken.try_clone()
    }

    /// What a device has told, in the order of arrival.
    pub fn next_reading(&self) -> Option<Reading> {
        self.readings.try_recv().ok()
    }

    /// Sends a command to every device; each takes what concerns it.
    pub fn command(&self, command: &Command) {
        self.letters.iter().for_each(|letters| letters.send(command.clone()));
    }
}

impl Drop for Devices {
    fn drop(&mut self) {
        // Closes the mailboxes.
        self.letters.clear();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn keep(named: &NamedDevice, place: &Place, mailbox: &Mailbox, reporter: &Reporter) {
    let mut told = State::Connecting;
    while !mailbox.is_closed() {
        let Err(error) = named.device.serve(place, mailbox, reporter) else { return };
        let state = State::Lost(error.to_string());
        // The same reason again and again is told once for each session.
        if reporter.took_up() || state != told {
            told = state.clone();
            reporter.state(state);
        }
        mailbox.idle(AGAIN);
    }
}
