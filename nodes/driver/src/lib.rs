//! Drives one platform: simulated hardware, a recording, or real hardware, behind one safety gate.
//!
//! Publishes measurements (`imu/data_raw`, `wheels/state`, ...), obeys `actuators/command`. When
//! commands stop arriving it closes all valves and sets wheel torque to zero within 100 ms.

pub mod core;
pub mod faults;
pub mod gate;
pub mod hardware;
pub mod parameters;
pub mod replay;
pub mod simulated;

pub use crate::core::DriverCore;
pub use parameters::{Backend, Parameters};

use thiserror::Error;
use whorl_dynamics::PlantError;

use crate::hardware::Hardware;
use crate::replay::{RecordedMeasurement, Replay};
use crate::simulated::SimulatedHardware;

/// Why a driver cannot start.
#[derive(Debug, Error)]
pub enum DriverError {
    /// The truth cannot be simulated.
    #[error("the platform cannot be simulated: {0}")]
    Plant(#[from] PlantError),
    /// There is no driver for real hardware yet.
    #[error(
        "backend hardware: there is no driver for the {purpose} ({device}{}) yet; use backend sim or replay",
        if *.present { "" } else { ", which is not there" }
    )]
    MissingDevice {
        /// What the device is for.
        purpose: &'static str,
        /// Its path.
        device: String,
        /// Whether the path exists.
        present: bool,
    },
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
    /// A driver with the backend in the parameters. `recording` is read by the caller for
    /// [`Backend::Replay`]; `device_present` tells whether a device path exists.
    ///
    /// # Errors
    /// See [`DriverError`].
    pub fn from_parameters(
        parameters: &Parameters,
        recording: Vec<RecordedMeasurement>,
        device_present: impl Fn(&str) -> bool,
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
            Backend::Hardware { devices } => {
                let missing = devices.iter().find(|(_, path)| !device_present(path)).or(devices.first());
                let (purpose, device) = missing.map_or(("platform", String::new()), |(p, d)| (*p, d.clone()));
                let present = device_present(&device);
                return Err(DriverError::MissingDevice { purpose, device, present });
            }
        };
        Ok(Self::new(parameters.clone(), hardware))
    }
}
