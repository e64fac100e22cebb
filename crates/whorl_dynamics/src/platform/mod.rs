//! The parts of a platform, as in its parameter file.
//!
//! Everything here is data, valid by construction or checked by `whorl_params` with the range
//! given in each field's doc. The truth of a simulation and the model that estimator and control
//! use are two values of the same type.

pub(crate) mod freedom;
mod prior;
mod reference;
pub(crate) mod sensors;

pub use crate::actuators::jets::{Jet, Tank};
pub use crate::actuators::wheels::Wheel;
pub use freedom::Freedom;
pub use prior::ModelPrior;
pub use sensors::{
    Accelerometer, BusVoltage, RateGyro, ScalarSensor, SensorSuite, TriaxialErrors, VectorSensor,
    WheelSpeedSensor,
};

use std::collections::BTreeMap;

use crate::MassProperties;
use crate::actuators::Actuators;

/// A platform.
#[derive(Debug, Clone, PartialEq)]
pub struct PlatformModel {
    /// Mass, inertia, gravity offset.
    pub mass_properties: MassProperties,
    /// The motion that the rig leaves the body.
    pub freedom: Freedom,
    /// The actuators, by kind.
    pub actuators: Actuators,
    /// Bus voltage supply at full charge and its fall, for actuators that depend on it.
    pub bus: BusVoltage,
    /// Where the bearing stops; [`TiltLimit::NONE`] for rigs that do not.
    pub tilt_limit: TiltLimit,
    /// The sensors.
    pub sensors: SensorSuite,
    /// Physical effects beyond the base model: effect id of the catalogue -> parameter name -> value.
    /// Names and ranges are checked against the catalogue when the model is read.
    pub effects: BTreeMap<String, BTreeMap<String, f64>>,
}

/// Where the bearing stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TiltLimit {
    /// Tabletop: the angle between body z and the vertical stays below this.
    Cone {
        /// Largest tilt \[rad\], 0 < x < pi; pi where nothing stops it.
        max_rad: f64,
    },
    /// Dumbbell: the elevation of body x above the horizontal stays within +- this; yaw and roll
    /// (about body x) are free.
    Pitch {
        /// Largest pitch \[rad\], 0 < x < pi/2.
        max_rad: f64,
    },
}

impl TiltLimit {
    /// No stop: no attitude lies beyond it.
    pub const NONE: Self = Self::Cone { max_rad: std::f64::consts::PI };

    /// Its angle \[rad\].
    #[must_use]
    pub fn max_rad(&self) -> f64 {
        match *self {
            Self::Cone { max_rad } | Self::Pitch { max_rad } => max_rad,
        }
    }

    /// The same kind at another angle \[rad\].
    #[must_use]
    pub fn with_max_rad(&self, max_rad: f64) -> Self {
        match self {
            Self::Cone { .. } => Self::Cone { max_rad },
            Self::Pitch { .. } => Self::Pitch { max_rad },
        }
    }

    /// Whether there is a stop.
    #[must_use]
    pub fn stops(&self) -> bool {
        *self != Self::NONE
    }
}
