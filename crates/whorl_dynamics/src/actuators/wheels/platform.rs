//! The wheels of a platform.

use super::Wheel;
use crate::PlatformModel;

impl PlatformModel {
    /// Its momentum wheels, in the order of every per-wheel array in messages.
    #[must_use]
    pub fn wheels(&self) -> &[Wheel] {
        &self.actuators.wheels.0
    }

    /// Its momentum wheels, to be changed.
    pub fn wheels_mut(&mut self) -> &mut Vec<Wheel> {
        &mut self.actuators.wheels.0
    }
}
