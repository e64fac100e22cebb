//! What a device is to the rest: what it gives, where it is, how it is served and emulated.

use std::fmt;
use std::sync::Arc;

use nalgebra::{Unit, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::actuators::Kind;
use whorl_params::Reader;

use crate::DeviceError;
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;

/// A kind of device: one row of [`crate::KINDS`].
pub struct DeviceKind {
    /// As in parameter files.
    pub name: &'static str,
    /// What it is, in a few words.
    pub what: &'static str,
    /// Reads one device of this kind from the open group. `None` when something was wrong, which the reader then holds.
    pub read: fn(&mut Reader<'_>, &PlatformModel) -> Option<Box<dyn Device>>,
}

/// What a platform needs, or may have, and a device gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Angular rate and specific force.
    Imu,
    /// Angular rate or specific force along some axes: part of a logical sensor.
    InertialAxes,
    /// Direction to the vector sensor's target.
    Direction,
    /// One motor of a kind of actuator.
    Motor(Kind, usize),
    /// The valve of one jet.
    Jet(usize),
    /// The contact of the emergency stop.
    EmergencyStop,
    /// Voltage of the power bus.
    BusVoltage,
    /// Current that the platform draws from its power bus.
    BusCurrent,
    /// Pressure in the tank of the jets.
    TankPressure,
    /// Temperature of the platform.
    Temperature,
}

impl Role {
    /// In words, for messages.
    #[must_use]
    pub fn words(self, model: &PlatformModel) -> String {
        let name = |names: Vec<&str>, index: usize| names.get(index).copied().unwrap_or("?").to_owned();
        match self {
            Self::Imu => "rate gyro and accelerometer".to_owned(),
            Self::InertialAxes => "single inertial axes".to_owned(),
            Self::Direction => "vector sensor".to_owned(),
            Self::Motor(kind, index) => {
                let kinds = Kind::ALL.into_iter().zip(model.actuators.kinds());
                let names = kinds.filter(|(k, _)| *k == kind).flat_map(|(_, row)| row.names()).collect();
                format!("motor of {}", name(names, index))
            }
            Self::Jet(jet) => {
                format!("valve of {}", name(model.jets().iter().map(|j| j.name.as_str()).collect(), jet))
            }
            Self::EmergencyStop => "emergency stop".to_owned(),
            Self::BusVoltage => "bus voltage".to_owned(),
            Self::BusCurrent => "bus current".to_owned(),
            Self::TankPressure => "tank pressure".to_owned(),
            Self::Temperature => "temperature".to_owned(),
        }
    }
}

/// A topic of another node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsedTopic {
    /// Its full name, as in the list of devices.
    pub name: String,
    /// Whether the device reads it, and does not write it.
    pub is_read: bool,
}

/// Why a device cannot be used on this computer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Wrong {
    /// What was found.
    pub found: String,
    /// The remedy.
    pub remedy: String,
}

/// One device of a platform.
pub trait Device: fmt::Debug + Send + Sync {
    /// What nobody else on this platform may use at the same time.
    fn addresses(&self) -> Vec<Address>;

    /// A port or folder of this computer without which there is no such device.
    fn path(&self) -> Option<&str> {
        None
    }

    /// Address and port of a host on the network, without which there is no such device.
    fn host(&self) -> Option<&str> {
        None
    }

    /// Topics of other nodes, without which there is no such device.
    fn topics(&self) -> Vec<UsedTopic> {
        Vec::new()
    }

    /// What a look at it shows that moves nothing and takes nothing from others, where that is more than whether path, host and
    /// topics are there.
    fn inspect(&self, _: &Place) -> Option<Result<String, Wrong>> {
        None
    }

    /// What it gives.
    fn roles(&self) -> Vec<Role>;

    /// Along what it measures angular rate and specific force.
    fn inertial_axes(&self) -> InertialAxes {
        if self.roles().contains(&Role::Imu) { InertialAxes::triads() } else { InertialAxes::default() }
    }

    /// Connects and serves until the mailbox is closed. Begins and ends with everything that it moves switched off.
    ///
    /// # Errors
    /// Why the device was lost. The caller tries again.
    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError>;

    /// Something that behaves as the device on its wire.
    fn emulator(&self, model: &PlatformModel) -> Emulator;
}

/// What only one device may use: a serial port, a coil of a relay board, a channel of a converter.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address(pub String);

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// A device under the user's name.
#[derive(Debug, Clone)]
pub struct NamedDevice {
    /// The user's name.
    pub name: String,
    /// Name of its row in [`crate::KINDS`].
    pub kind: &'static str,
    /// The device.
    pub device: Arc<dyn Device>,
}

/// Directions along which a device measures, body axes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InertialAxes {
    /// Of angular rate.
    pub rate_b: Vec<Unit<Vector3<f64>>>,
    /// Of specific force.
    pub force_b: Vec<Unit<Vector3<f64>>>,
}

impl InertialAxes {
    /// Rate and specific force along all three axes.
    #[must_use]
    pub fn triads() -> Self {
        let axes = vec![Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        Self { rate_b: axes.clone(), force_b: axes }
    }

    /// Neither.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rate_b.is_empty() && self.force_b.is_empty()
    }
}
