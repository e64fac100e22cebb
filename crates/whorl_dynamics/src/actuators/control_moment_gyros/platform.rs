//! The control moment gyros of a platform.

use super::Gyro;
use crate::PlatformModel;

impl PlatformModel {
    /// Its control moment gyros, in the order of every per-gyro array in messages.
    #[must_use]
    pub fn gyros(&self) -> &[Gyro] {
        &self.actuators.control_moment_gyros.0
    }

    /// Its control moment gyros, to be changed.
    pub fn gyros_mut(&mut self) -> &mut Vec<Gyro> {
        &mut self.actuators.control_moment_gyros.0
    }
}
