//! A session with a board.

use std::time::Duration;

use tokio_modbus::client::sync::{Context, Reader as _, Writer, tcp};
use tokio_modbus::slave::Slave;

use super::Relays;
use crate::DeviceError;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;
use crate::valves::{self, Board};

/// The board has so long to answer; a pulse is late by as much.
const ANSWER: Duration = Duration::from_millis(50);
const CONNECT: Duration = Duration::from_secs(1);

/// Connects, and works the valves until the session ends.
pub(super) fn serve(
    setup: &Relays,
    place: &Place,
    mailbox: &Mailbox,
    reporter: &Reporter,
) -> Result<(), DeviceError> {
    let address = place.host(&setup.host).map_err(DeviceError::io("cannot find", &setup.host))?;
    let mut board = tcp::connect_slave_with_timeout(address, Slave(setup.unit), Some(CONNECT))
        .map_err(DeviceError::io("cannot reach", &setup.host))?;
    board.set_timeout(ANSWER);
    valves::serve(&mut Connected { board, setup }, &setup.coils, mailbox, reporter)
}

/// A board that answers.
struct Connected<'a> {
    board: Context,
    setup: &'a Relays,
}

impl Connected<'_> {
    fn lost(&self, error: tokio_modbus::Error) -> DeviceError {
        match error {
            tokio_modbus::Error::Transport(error) => DeviceError::io("lost", &self.setup.host)(error),
            tokio_modbus::Error::Protocol(error) => DeviceError::Refused(error.to_string()),
        }
    }
}

impl Board for Connected<'_> {
    fn write(&mut self, open: &[bool]) -> Result<(), DeviceError> {
        let answer = self.board.write_multiple_coils(self.setup.first_coil, open);
        let answer = answer.map_err(|error| self.lost(error))?;
        answer.map_err(|exception| DeviceError::Refused(exception.to_string()))
    }

    fn stop_is_released(&mut self) -> Result<Option<bool>, DeviceError> {
        let Some(input) = self.setup.stop_input else { return Ok(None) };
        let answer = self.board.read_discrete_inputs(input, 1).map_err(|error| self.lost(error))?;
        let inputs = answer.map_err(|exception| DeviceError::Refused(exception.to_string()))?;
        Ok(Some(inputs.first().copied().unwrap_or(false)))
    }
}
