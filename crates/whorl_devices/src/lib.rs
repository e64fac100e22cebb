//! Sensors and actuators of a platform over their own protocols.
//!
//! A platform's parameter file lists its devices ([`DeviceList`]); each kind of device is one folder, with its protocol as
//! pure functions, its parameters, its session and an emulator that speaks the same bytes, and one row of [`KINDS`].
//! [`Devices`] runs every device in a thread of its own, which connects, commands, measures, and connects again when the
//! device was lost. [`emulation`] puts emulators of the same list behind pseudo-terminals, sockets and files, with a
//! simulated platform behind them.
//!
//! Where a wire ends, everything is in SI units and in the body axes of the platform. Sensors' axes and signs of wires are
//! matters of the list.

pub mod bus;
mod can_motors;
pub mod checkout;
pub mod cia402;
mod device;
pub mod emulation;
pub mod gpio;
pub mod hwmon;
pub mod iio;
mod kinds;
mod list;
pub mod logical;
mod mailbox;
pub mod modbus_relays;
pub mod odrive;
mod place;
mod reading;
pub mod ros;
mod running;
mod schedule;
pub mod smartmotor;
mod timing;
mod valves;
#[cfg(test)]
mod valves_bench;
pub mod vn100;

pub use device::{Address, Device, DeviceKind, InertialAxes, NamedDevice, Role, UsedTopic, Wrong};
pub use kinds::KINDS;
pub use list::{DeviceList, read};
pub use mailbox::{Command, Mailbox};
pub use place::Place;
pub use reading::{Joint, Measured, Reading, Reporter, State};
pub use running::Devices;

use thiserror::Error;

/// Why a device cannot be used now. A session ends with it; the next one begins shortly after.
#[derive(Debug, Error)]
pub enum DeviceError {
    /// It is not there, or the operating system refuses.
    #[error("{what} {address}: {source}")]
    Io {
        /// What was tried.
        what: &'static str,
        /// On which port, file or host.
        address: String,
        /// Why not.
        source: std::io::Error,
    },
    /// It does not say anything, or nothing that can be understood.
    #[error("no valid answer for {0:.2} s")]
    Silent(f64),
    /// DDS, or what ROS 2's environment variables say.
    #[error("ROS 2: {0}")]
    Ros(#[from] whorl_node::TransportError),
    /// It refuses.
    #[error("it refuses: {0}")]
    Refused(String),
}

impl DeviceError {
    /// What a program without the feature `buses` says.
    #[cfg(not(feature = "buses"))]
    pub(crate) fn built_without_buses(address: &str) -> Self {
        Self::Refused(format!(
            "{address}: this program was built without CAN, GPIO and Modbus (feature `buses` of whorl_devices)"
        ))
    }

    /// Wraps an error of the operating system.
    pub(crate) fn io<E: Into<std::io::Error>>(what: &'static str, address: &str) -> impl Fn(E) -> Self {
        move |source| Self::Io { what, address: address.to_owned(), source: source.into() }
    }
}
