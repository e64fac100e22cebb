//! Solenoid valves of the jets on a relay or output board that speaks Modbus/TCP.
//!
//! All valves are written in one request (function 15, Write Multiple Coils) at every edge of a pulse, and again every 50 ms, so
//! that the board's own watchdog notices when the platform's computer is gone. Requests and answers are `tokio-modbus`'s.
//! Coils are consecutive: one request must not touch what belongs to others.

mod emulator;
pub mod protocol;
#[cfg(feature = "buses")]
mod session;
#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, range};

use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;
use crate::valves::{self, Outlet};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "modbus_relays",
    what: "relay or output board, Modbus/TCP: solenoid valves of the jets",
    read,
};

/// One board.
#[derive(Debug, Clone)]
struct Relays {
    host: String,
    unit: u8,
    first_coil: u16,
    /// The board switches off so long after the last request \[s\]; 0: it does not.
    watchdog_s: f64,
    /// Discrete input that is on while the emergency stop is released.
    stop_input: Option<u16>,
    /// Consecutive.
    coils: Vec<Outlet>,
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
    let coils = valves::read(r, model, "coils", u32::from(u16::MAX), "coil of the valve, from 0");
    let span = |coils: &[Outlet]| Some(coils.last()?.output - coils.first()?.output + 1);
    if r.error_count() == before && span(&coils) != u32::try_from(coils.len()).ok() {
        let problem =
            "allowed: consecutive numbers, one for each jet, because one request writes all of them";
        r.reject("coils", problem);
    }
    let first_coil = coils.first().and_then(|coil| u16::try_from(coil.output).ok()).unwrap_or(0);
    let unit = u8::try_from(unit).unwrap_or(1);
    let stop_input = stop_input.and_then(|input| u16::try_from(input).ok());
    (r.error_count() == before).then(|| {
        Box::new(Relays { host, unit, first_coil, watchdog_s, stop_input, coils }) as Box<dyn Device>
    })
}

impl Device for Relays {
    fn addresses(&self) -> Vec<Address> {
        let address =
            |coil: &Outlet| Address(format!("{} unit {} coil {}", self.host, self.unit, coil.output));
        self.coils.iter().map(address).collect()
    }

    fn host(&self) -> Option<&str> {
        Some(&self.host)
    }

    fn roles(&self) -> Vec<Role> {
        let stop = self.stop_input.map(|_| Role::EmergencyStop);
        self.coils.iter().map(|coil| Role::Jet(coil.jet)).chain(stop).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        #[cfg(feature = "buses")]
        {
            session::serve(self, place, mailbox, reporter)
        }
        #[cfg(not(feature = "buses"))]
        {
            let _ = (place, mailbox, reporter);
            Err(DeviceError::built_without_buses(&self.host))
        }
    }

    fn emulator(&self, model: &PlatformModel) -> Emulator {
        emulator::new(self, model)
    }
}
