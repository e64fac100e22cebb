//! Solenoid valves of the jets on a relay or output board that speaks Modbus/TCP.
//!
//! All valves are written in one request (function 15, Write Multiple Coils) at every edge of a pulse, and again every 50 ms, so
//! that the board's own watchdog notices when the platform's computer is gone. Requests and answers are `tokio-modbus`'s.
//! Coils are consecutive: one request must not touch what belongs to others.

mod emulator;
pub mod protocol;
#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use tokio_modbus::client::sync::{Context, Reader as _, Writer, tcp};
use tokio_modbus::slave::Slave;
use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, range};

use crate::DeviceError;
use crate::emulation::Emulator;
use crate::kinds::{Device, DeviceKind, Role};
use crate::list::Address;
use crate::mailbox::Mailbox;
use crate::reading::{Measured, Reporter, State};
use crate::running::Place;
use crate::schedule::Schedule;

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "modbus_relays",
    what: "relay or output board, Modbus/TCP: solenoid valves of the jets",
    read,
};

/// The board has so long to answer; a pulse is late by as much.
const ANSWER: Duration = Duration::from_millis(50);
const CONNECT: Duration = Duration::from_secs(1);
/// Between requests without an edge, for the board's watchdog.
const REFRESH: Duration = Duration::from_millis(50);

/// One board.
#[derive(Debug, Clone)]
struct Board {
    host: String,
    unit: u8,
    first_coil: u16,
    /// The board switches off so long after the last request \[s\]; 0: it does not.
    watchdog_s: f64,
    /// Discrete input that is on while the emergency stop is released.
    stop_input: Option<u16>,
    /// Of each coil from the first: the jet, and its shortest pulse \[s\].
    jets: Vec<(usize, f64)>,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let host = r.string("host", "address and port of the board, such as 192.168.1.51:502");
    let port = host.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
    if port.is_none() && r.error_count() == before {
        r.reject("host", "it names no port; allowed: address:port, such as 192.168.1.51:502");
    }
    let unit = r.i64_or("unit", 1, range(0..=255), "unit identifier of the board");
    let watchdog_s = r.f64_or(
        "watchdog_s",
        0.2,
        range(0.0..=60.0),
        "the board closes all valves so long after the last request [s], as set in the board; 0: it has no watchdog",
    );
    let stop_input = r.optional_i64(
        "emergency_stop_input",
        range(0..=65_535),
        "discrete input with the contact of the emergency stop, on while it is released; left out: none",
    );
    let names: Vec<&str> = model.jets().iter().map(|jet| jet.name.as_str()).collect();
    let mut coils: Vec<(i64, String)> = Vec::new();
    for name in r.children("coils") {
        let coil = r.group("coils", |r| r.i64(&name, range(0..=65_535), "coil of the valve, from 0"));
        if !names.contains(&name.as_str()) {
            r.reject(
                &format!("coils.{name}"),
                format!("{name} is no jet of this platform; allowed: {}", names.join(", ")),
            );
        } else if let Some((_, other)) = coils.iter().find(|(c, _)| *c == coil) {
            r.reject(
                &format!("coils.{name}"),
                format!("{other} has coil {coil} already; allowed: a coil of its own"),
            );
        } else {
            coils.push((coil, name));
        }
    }
    coils.sort_unstable();
    let span = |coils: &[(i64, String)]| Some(coils.last()?.0 - coils.first()?.0 + 1);
    if r.error_count() == before && span(&coils) != i64::try_from(coils.len()).ok() {
        let problem =
            "allowed: consecutive numbers, one for each jet, because one request writes all of them";
        r.reject("coils", problem);
    }
    let jet = |name: &str| {
        let index = names.iter().position(|known| *known == name)?;
        Some((index, model.jets().get(index)?.min_on_time_s))
    };
    let jets: Vec<(usize, f64)> = coils.iter().filter_map(|(_, name)| jet(name)).collect();
    let first_coil = coils.first().and_then(|(coil, _)| u16::try_from(*coil).ok()).unwrap_or(0);
    let unit = u8::try_from(unit).unwrap_or(1);
    let stop_input = stop_input.and_then(|input| u16::try_from(input).ok());
    (r.error_count() == before)
        .then(|| Box::new(Board { host, unit, first_coil, watchdog_s, stop_input, jets }) as Box<dyn Device>)
}

impl Device for Board {
    fn addresses(&self) -> Vec<Address> {
        let coil = |index: usize| usize::from(self.first_coil) + index;
        (0..self.jets.len())
            .map(|index| Address(format!("{} unit {} coil {}", self.host, self.unit, coil(index))))
            .collect()
    }

    fn host(&self) -> Option<&str> {
        Some(&self.host)
    }

    fn roles(&self) -> Vec<Role> {
        let stop = self.stop_input.map(|_| Role::EmergencyStop);
        self.jets.iter().map(|(jet, _)| Role::Jet(*jet)).chain(stop).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let address = place.host(&self.host).map_err(DeviceError::io("cannot find", &self.host))?;
        let mut board = tcp::connect_slave_with_timeout(address, Slave(self.unit), Some(CONNECT))
            .map_err(DeviceError::io("cannot reach", &self.host))?;
        board.set_timeout(ANSWER);
        let mut schedule = Schedule::new(self.jets.clone());
        // Closed before anything else: the board may have been left as it was.
        self.write(&mut board, &mut schedule, reporter)?;
        self.look_at_stop(&mut board, reporter)?;
        reporter.state(State::Ready);
        let mut refresh = Instant::now() + REFRESH;
        let mut look = refresh;
        loop {
            let until = if self.stop_input.is_some() { refresh.min(look) } else { refresh };
            mailbox.wait(None, schedule.next_edge().map_or(until, |edge| edge.min(until)));
            schedule.obey(mailbox);
            if mailbox.is_closed() {
                schedule.close();
                return self.write(&mut board, &mut schedule, reporter);
            }
            let is_due = Instant::now() >= refresh;
            if schedule.advance(Instant::now()) || is_due {
                refresh = Instant::now() + REFRESH;
                self.write(&mut board, &mut schedule, reporter)?;
            }
            if is_due || Instant::now() >= look {
                look = Instant::now() + REFRESH;
                self.look_at_stop(&mut board, reporter)?;
            }
        }
    }

    fn emulator(&self, model: &PlatformModel) -> Emulator {
        emulator::new(self, model)
    }
}

impl Board {
    /// Tells whether the emergency stop is pressed. A wire that is broken counts as that.
    fn look_at_stop(&self, board: &mut Context, reporter: &Reporter) -> Result<(), DeviceError> {
        let Some(input) = self.stop_input else { return Ok(()) };
        let answer = board.read_discrete_inputs(input, 1).map_err(|error| self.lost(error))?;
        let inputs = answer.map_err(|exception| DeviceError::Refused(exception.to_string()))?;
        let is_released = inputs.first().copied().unwrap_or(false);
        reporter.measured(Instant::now(), Measured::EmergencyStop(!is_released));
        Ok(())
    }

    fn lost(&self, error: tokio_modbus::Error) -> DeviceError {
        match error {
            tokio_modbus::Error::Transport(error) => DeviceError::io("lost", &self.host)(error),
            tokio_modbus::Error::Protocol(error) => DeviceError::Refused(error.to_string()),
        }
    }

    /// Makes the valves what they should be, and tells which of them were switched.
    fn write(
        &self,
        board: &mut Context,
        schedule: &mut Schedule,
        reporter: &Reporter,
    ) -> Result<(), DeviceError> {
        let wanted = schedule.wanted().to_vec();
        let answer =
            board.write_multiple_coils(self.first_coil, &wanted).map_err(|error| self.lost(error))?;
        answer.map_err(|exception| DeviceError::Refused(exception.to_string()))?;
        let switched = schedule.written();
        if !switched.is_empty() {
            reporter.measured(Instant::now(), Measured::Valves(switched));
        }
        Ok(())
    }
}
