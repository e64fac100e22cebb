//! Drives one platform: simulated hardware, a recording, or real hardware, behind one safety gate.
//!
//! Publishes measurements (`imu/data_raw`, `wheels/state`, ...), obeys `actuators/command`. When
//! commands stop arriving it closes all valves and sets wheel torque to zero within 100 ms.

pub mod arming;
pub mod core;
pub mod devices;
pub mod faults;
pub mod gate;
pub mod hardware;
pub mod messages;
pub mod parameters;
pub mod prearm;
pub mod replay;
pub mod simulated;

pub use crate::core::DriverCore;
pub use parameters::{Backend, Parameters};

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use thiserror::Error;
use whorl_devices::{Devices, Place};
use whorl_dynamics::PlantError;
use whorl_node::{ForeignNetwork, Timestamp};

use crate::devices::DeviceHardware;
use crate::hardware::Hardware;
use crate::replay::{RecordedMeasurement, Replay};
use crate::simulated::SimulatedHardware;

/// Why a driver cannot start.
#[derive(Debug, Error)]
pub enum DriverError {
    /// The truth cannot be simulated.
    #[error("the platform cannot be simulated: {0}")]
    Plant(#[from] PlantError),
    /// A port or folder of a device is not there.
    #[error(
        "backend hardware: device {device} is not there: {path}; plug it in, correct the file's devices.{device}, or \
         start emulators (launch_scripts/start_emulators.sh)"
    )]
    MissingDevice {
        /// Name of the device.
        device: String,
        /// Where it was looked for.
        path: String,
    },
    /// The devices cannot be started.
    #[error("backend hardware: the devices cannot be started: {0}")]
    Devices(#[from] std::io::Error),
    /// There is nobody to start devices.
    #[error("backend hardware needs a node of its own")]
    NoDevices,
    /// The recording has nothing to replay.
    #[error("{source_name} holds no measurements of platform {platform}")]
    EmptyRecording {
        /// Its name.
        source_name: String,
        /// The platform.
        platform: String,
    },
}

impl DriverCore {
    /// A driver with the backend in the parameters. `recording` is read by the caller for [`Backend::Replay`]; `devices`
    /// are started by the caller for [`Backend::Hardware`], see [`start_devices`].
    ///
    /// # Errors
    /// See [`DriverError`].
    pub fn from_parameters(
        parameters: &Parameters,
        recording: Vec<RecordedMeasurement>,
        devices: Option<StartedDevices>,
    ) -> Result<Self, DriverError> {
        let hardware: Box<dyn Hardware> = match &parameters.backend {
            Backend::Simulated { truth, start, seed, faults } => {
                let hardware =
                    SimulatedHardware::new((**truth).clone(), start.clone(), *seed, faults.clone())?;
                Box::new(hardware.with_watchdog(parameters.watchdog_s))
            }
            Backend::Replay { source, .. } if recording.is_empty() => {
                let (source_name, platform) = (source.clone(), parameters.name.clone());
                return Err(DriverError::EmptyRecording { source_name, platform });
            }
            Backend::Replay { source, .. } => Box::new(Replay::new(source.clone(), recording)),
            Backend::Hardware { root } => {
                let place = root.as_ref().map_or_else(String::new, |root| format!(", EMULATED in {root}"));
                let devices = devices.ok_or(DriverError::NoDevices)?;
                Box::new(DeviceHardware::new(parameters, devices, place))
            }
        };
        Ok(Self::new(parameters.clone(), hardware))
    }
}

/// Devices at work, and the clocks of the node that drives them.
#[derive(Debug)]
pub struct StartedDevices {
    /// The devices.
    pub devices: Devices,
    /// A time of the node, and the instant of it.
    pub began: (Timestamp, Instant),
}

/// Starts the devices of a driver with backend hardware, each in a thread; `None` for other backends. Topics of other
/// people's nodes are looked for on `network`.
///
/// # Errors
/// A port or folder that is not there.
pub fn start_devices(
    parameters: &Parameters,
    network: Arc<dyn ForeignNetwork>,
) -> Result<Option<Devices>, DriverError> {
    let Backend::Hardware { root } = &parameters.backend else { return Ok(None) };
    let place = Place { root: root.as_ref().map(PathBuf::from), network: Some(network) };
    for named in &parameters.devices.devices {
        let path = named.device.path().map(|path| place.path(path)).filter(|path| !path.exists());
        if let Some(path) = path {
            return Err(DriverError::MissingDevice {
                device: named.name.clone(),
                path: path.display().to_string(),
            });
        }
    }
    Ok(Some(Devices::start(&parameters.devices, &place)?))
}
