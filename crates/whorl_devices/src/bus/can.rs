//! A CAN bus: Linux's SocketCAN, or a socket that carries the same records in its place.
//!
//! A record is the kernel's `struct can_frame` (linux/can.h): identifier with flags, length, three bytes of padding, eight of
//! data. On a CAN socket each read is one record; on a TCP socket they follow each other.

use std::fmt;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use whorl_params::Reader;

use super::frame::{Frame, Record, Records};
use crate::DeviceError;
use crate::device::{Address, Wrong};
use crate::place::Place;

/// A bus that takes no frames for so long is stuck.
const STUCK: Duration = Duration::from_millis(100);
const CONNECT: Duration = Duration::from_secs(1);
/// What ends the queue of an interface that sends as quickly as it can (`ENOBUFS` of Linux).
const QUEUE_IS_FULL: i32 = 105;
/// Of an interface's name (linux/if.h).
const LONGEST_NAME: usize = 15;
const SOCKET: &str = "tcp:";

/// Where a bus is, as in the list of devices: `can0`, or `tcp:HOST:PORT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bus(String);

impl fmt::Display for Bus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Bus {
    /// Reads the parameter `bus`.
    pub(crate) fn read(r: &mut Reader<'_>) -> Self {
        let before = r.error_count();
        let name = r.string("bus", "CAN interface, such as can0, or tcp:HOST:PORT: a socket in its place");
        let fits = match name.strip_prefix(SOCKET) {
            Some(host) => host.rsplit_once(':').is_some_and(|(host, port)| {
                !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0)
            }),
            None => {
                (1..=LONGEST_NAME).contains(&name.len())
                    && !name.contains(|c: char| c == '/' || c == ':' || c.is_whitespace())
            }
        };
        if !fits && r.error_count() == before {
            r.reject("bus", "allowed: the name of an interface, such as can0, or tcp:HOST:PORT");
        }
        Self(name)
    }

    /// Address and port of the socket in the bus's place.
    pub(crate) fn host(&self) -> Option<&str> {
        self.0.strip_prefix(SOCKET)
    }

    /// The name under which the emulator of a device keeps its socket. Emulated devices of one interface do not hear each other;
    /// a socket in place of the bus has one of them.
    pub(crate) fn emulated(&self, device: u16) -> String {
        self.host().map_or_else(|| format!("{} of 0x{device:03X}", self.0), str::to_owned)
    }

    /// These identifiers, of which each belongs to one device.
    pub(crate) fn addresses(&self, identifiers: impl Iterator<Item = u16>) -> Vec<Address> {
        identifiers.map(|id| Address(format!("identifier 0x{id:03X} on {}", self.0))).collect()
    }

    /// What this computer says of the interface.
    pub(crate) fn inspect(&self, place: &Place) -> Option<Result<String, Wrong>> {
        if place.root.is_some() || self.host().is_some() {
            return None;
        }
        let flags = format!("/sys/class/net/{}/flags", self.0);
        let Ok(flags) = std::fs::read_to_string(flags) else {
            return Some(Err(Wrong {
                found: format!("there is no network interface {}", self.0),
                remedy: "plug the CAN adapter in; ip -details link show type can lists what there is"
                    .to_owned(),
            }));
        };
        let number = u32::from_str_radix(flags.trim().trim_start_matches("0x"), 16).unwrap_or(0);
        // IFF_UP.
        Some(if number & 1 == 1 {
            Ok(format!("{} is up", self.0))
        } else {
            let remedy = format!("sudo ip link set {} up type can bitrate 1000000 restart-ms 100", self.0);
            Err(Wrong { found: format!("{} is down", self.0), remedy })
        })
    }
}

/// What carries records: the kernel's CAN, or a socket in its place.
trait Carrier: Read + Write + AsFd + fmt::Debug {}
#[cfg(feature = "buses")]
impl Carrier for socketcan::CanSocket {}
impl Carrier for TcpStream {}

/// An open bus.
#[derive(Debug)]
pub struct Can {
    carrier: Box<dyn Carrier>,
    records: Records,
    address: String,
}

impl Can {
    /// Opens it, for frames of these identifiers. `emulated` names the socket that an emulator offers in its place.
    ///
    /// # Errors
    /// No such interface or host, or it is down.
    pub(crate) fn open(
        bus: &Bus,
        place: &Place,
        identifiers: &[u16],
        emulated: &str,
    ) -> Result<Self, DeviceError> {
        let address = bus.to_string();
        let host = if place.root.is_some() { Some(emulated) } else { bus.host() };
        let carrier: Box<dyn Carrier> = match host {
            Some(host) => {
                let there = place.host(host).map_err(DeviceError::io("cannot find", &address))?;
                let reach = DeviceError::io("cannot reach", &address);
                let stream = TcpStream::connect_timeout(&there, CONNECT).map_err(&reach)?;
                stream.set_nodelay(true).map_err(&reach)?;
                stream.set_nonblocking(true).map_err(&reach)?;
                Box::new(stream)
            }
            None => kernels(&address, identifiers)?,
        };
        Ok(Self { carrier, records: Records::default(), address })
    }

    /// For waiting until it has frames.
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.carrier.as_fd()
    }

    /// Everything that has arrived; waits for nothing.
    ///
    /// # Errors
    /// The interface is down or gone, the controller has left the bus, or the socket was closed.
    pub(crate) fn read(&mut self, into: &mut Vec<Frame>) -> Result<(), DeviceError> {
        let mut buffer = [0; 64 * Frame::RECORD];
        loop {
            match self.carrier.read(&mut buffer) {
                Ok(0) => return Err(self.lost(ErrorKind::UnexpectedEof.into())),
                Ok(count) => self.records.push(buffer.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
        while let Some(record) = self.records.next_record() {
            match record {
                Record::Frame(frame) => into.push(frame),
                Record::Error => {
                    let problem =
                        format!("{}: the CAN controller has left the bus after errors", self.address);
                    return Err(DeviceError::Refused(problem));
                }
                Record::Other => {}
            }
        }
        Ok(())
    }

    /// Bytes that were no record, since the last call.
    pub(crate) fn take_refused(&mut self) -> u64 {
        self.records.take_refused()
    }

    /// Sends frames, in this order.
    ///
    /// # Errors
    /// The bus is gone, or takes nothing for 0.1 s, as where no other controller is switched on.
    pub(crate) fn write(&mut self, frames: &[Frame]) -> Result<(), DeviceError> {
        let began = Instant::now();
        for frame in frames {
            let record = frame.record();
            let mut left: &[u8] = &record;
            while !left.is_empty() {
                match self.carrier.write(left) {
                    Ok(count) => left = left.get(count..).unwrap_or_default(),
                    Err(error) if is_full(&error) && began.elapsed() < STUCK => self.wait_to_write(),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => return Err(self.lost(error)),
                }
            }
        }
        Ok(())
    }

    /// Waits for frames until this time.
    pub(crate) fn wait(&self, until: Instant) {
        let left = until.saturating_duration_since(Instant::now()).as_nanos();
        let timeout = Timespec { tv_sec: 0, tv_nsec: i64::try_from(left).unwrap_or(0).min(999_999_999) };
        let _ = poll(&mut [PollFd::from_borrowed_fd(self.fd(), PollFlags::IN)], Some(&timeout));
    }

    fn wait_to_write(&self) {
        // A full queue of the interface does not show in poll.
        std::thread::sleep(Duration::from_micros(200));
        let wait = Timespec { tv_sec: 0, tv_nsec: 1_000_000 };
        let _ = poll(&mut [PollFd::from_borrowed_fd(self.fd(), PollFlags::OUT)], Some(&wait));
    }

    fn lost(&self, error: std::io::Error) -> DeviceError {
        DeviceError::io("lost", &self.address)(error)
    }
}

/// The kernel's bus.
#[cfg(feature = "buses")]
fn kernels(interface: &str, identifiers: &[u16]) -> Result<Box<dyn Carrier>, DeviceError> {
    use socketcan::{CanFilter, CanSocket, Socket, SocketOptions};
    /// Error frames that are wanted: the controller has left the bus (linux/can/error.h: `CAN_ERR_BUSOFF`).
    const BUS_OFF: u32 = 0x40;
    let io = DeviceError::io("cannot open", interface);
    let socket = CanSocket::open(interface).map_err(&io)?;
    // Standard frames of these identifiers alone, data or remote.
    let mask = u32::from(Frame::LARGEST_ID) | Frame::EXTENDED;
    let filters: Vec<CanFilter> = identifiers.iter().map(|id| CanFilter::new(u32::from(*id), mask)).collect();
    socket.set_filters(&filters).map_err(&io)?;
    socket.set_error_filter(BUS_OFF).map_err(&io)?;
    socket.set_nonblocking(true).map_err(&io)?;
    Ok(Box::new(socket))
}

#[cfg(not(feature = "buses"))]
fn kernels(interface: &str, _: &[u16]) -> Result<Box<dyn Carrier>, DeviceError> {
    Err(DeviceError::built_without_buses(interface))
}

fn is_full(error: &std::io::Error) -> bool {
    error.kind() == ErrorKind::WouldBlock || error.raw_os_error() == Some(QUEUE_IS_FULL)
}

#[cfg(all(test, feature = "buses"))]
mod tests {
    use socketcan::{CanFrame, CanSocket, EmbeddedFrame, Id, Socket, StandardId};

    use super::*;

    /// `sudo ip link add vcan0 type vcan && sudo ip link set vcan0 up`.
    const VIRTUAL: &str = "vcan0";

    #[test]
    fn frames_cross_the_kernels_bus() {
        let Ok(other) = CanSocket::open(VIRTUAL) else {
            println!("SKIPPED: no interface {VIRTUAL}");
            return;
        };
        other.set_read_timeout(Duration::from_secs(5)).unwrap();
        let mut can = Can::open(&Bus(VIRTUAL.to_owned()), &Place::default(), &[0x181], "").unwrap();
        can.write(&[Frame::new(0x201, &[1, 2, 3]), Frame::remote(0x29, 8)]).unwrap();
        let heard = other.read_frame().unwrap();
        assert_eq!(
            (heard.id(), heard.data()),
            (Id::Standard(StandardId::new(0x201).unwrap()), &[1, 2, 3][..])
        );
        let asked = other.read_frame().unwrap();
        assert!(asked.is_remote_frame() && asked.dlc() == 8);
        // Only what was asked for comes through.
        for id in [0x182, 0x181] {
            let frame = CanFrame::new(StandardId::new(id).unwrap(), &[7; 8]).unwrap();
            other.write_frame(&frame).unwrap();
        }
        can.wait(Instant::now() + Duration::from_secs(5));
        let mut frames = Vec::new();
        can.read(&mut frames).unwrap();
        assert_eq!(frames, [Frame::new(0x181, &[7; 8])]);
    }

    #[test]
    fn an_interface_that_is_not_there_is_said() {
        let bus = Bus("no_such_can".to_owned());
        let error = Can::open(&bus, &Place::default(), &[1], "").unwrap_err().to_string();
        assert!(error.contains("cannot open no_such_can"), "{error}");
        let wrong = bus.inspect(&Place::default()).unwrap().unwrap_err();
        assert!(wrong.found.contains("no_such_can") && wrong.remedy.contains("ip "), "{wrong:?}");
    }

    #[test]
    fn a_gateway_that_hangs_up_is_lost() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let bus = Bus(format!("tcp:{}", listener.local_addr().unwrap()));
        let mut can = Can::open(&bus, &Place::default(), &[1], "").unwrap();
        let (mut gateway, _) = listener.accept().unwrap();
        gateway.write_all(&Frame::new(1, &[5]).record()).unwrap();
        can.wait(Instant::now() + Duration::from_secs(5));
        let mut frames = Vec::new();
        can.read(&mut frames).unwrap();
        assert_eq!(frames, [Frame::new(1, &[5])]);
        can.write(&frames).unwrap();
        let mut record = [0; Frame::RECORD];
        gateway.read_exact(&mut record).unwrap();
        assert_eq!(record, frames[0].record());
        drop(gateway);
        can.wait(Instant::now() + Duration::from_secs(5));
        assert!(can.read(&mut frames).unwrap_err().to_string().contains("lost tcp:127.0.0.1"));
    }
}
