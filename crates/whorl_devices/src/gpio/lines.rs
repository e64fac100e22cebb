//! Lines behind one small interface; those of an emulated chip.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use super::Valves;
use super::protocol::{Answer, Call, LineRequest, LineValues};
use crate::DeviceError;
use crate::place::Place;

/// An emulated chip has so long to answer; calls of the kernel take microseconds, but a computer with emulators may be busy.
const ANSWER: Duration = Duration::from_millis(250);

/// Lines that were requested.
pub(super) trait Lines {
    /// Drives all outputs in one call. Bit k is the k-th of them.
    fn set(&mut self, active: u64) -> Result<(), DeviceError>;

    /// Whether the contact of the emergency stop is active.
    fn input(&mut self) -> Result<bool, DeviceError>;
}

/// An emulated chip: the arguments of the kernel's calls over a socket.
pub(super) struct Emulated {
    socket: TcpStream,
    chip: String,
    /// Bits of the outputs and of the contact.
    outputs: u64,
    input: u64,
}

impl Emulated {
    pub fn request(setup: &Valves, place: &Place) -> Result<Self, DeviceError> {
        let failed = |what: &'static str| DeviceError::io(what, &setup.chip);
        let address = place.host(&setup.chip).map_err(failed("cannot find"))?;
        let socket = TcpStream::connect_timeout(&address, ANSWER * 4).map_err(failed("cannot open"))?;
        socket.set_nodelay(true).map_err(failed("cannot open"))?;
        socket.set_read_timeout(Some(ANSWER)).map_err(failed("cannot open"))?;
        let count = setup.outputs().len();
        let outputs = (1_u64 << count) - 1;
        let input = u64::from(setup.stop.is_some()) << count;
        let mut lines = Self { socket, chip: setup.chip.clone(), outputs, input };
        lines.call(&Call::GetLine(LineRequest::of(setup)))?;
        Ok(lines)
    }

    /// What the kernel would have written into the argument.
    fn call(&mut self, call: &Call) -> Result<LineValues, DeviceError> {
        let lost = DeviceError::io("lost", &self.chip);
        self.socket.write_all(&call.bytes()).map_err(&lost)?;
        let mut bytes = [0; Answer::SIZE];
        self.socket.read_exact(&mut bytes).map_err(&lost)?;
        let answer = Answer::from_bytes(&bytes);
        if answer.error != 0 {
            return Err(lost(std::io::Error::from_raw_os_error(answer.error)));
        }
        Ok(answer.values)
    }
}

impl Lines for Emulated {
    fn set(&mut self, active: u64) -> Result<(), DeviceError> {
        let values = LineValues { bits: active, mask: self.outputs };
        self.call(&Call::SetValues(values)).map(|_| ())
    }

    fn input(&mut self) -> Result<bool, DeviceError> {
        let values = self.call(&Call::GetValues(LineValues { bits: 0, mask: self.input }))?;
        Ok(values.bits & self.input != 0)
    }
}
