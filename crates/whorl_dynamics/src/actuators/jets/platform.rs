//! The jets of a platform.

use super::{Jet, Tank};
use crate::PlatformModel;

impl PlatformModel {
    /// Its cold-gas jets, in the order of every per-jet array in messages.
    #[must_use]
    pub fn jets(&self) -> &[Jet] {
        &self.actuators.jets.list
    }

    /// Its cold-gas jets, to be changed.
    pub fn jets_mut(&mut self) -> &mut Vec<Jet> {
        &mut self.actuators.jets.list
    }

    /// Gas supply of its jets.
    #[must_use]
    pub fn tank(&self) -> &Tank {
        &self.actuators.jets.tank
    }

    /// Gas supply of its jets, to be changed.
    pub fn tank_mut(&mut self) -> &mut Tank {
        &mut self.actuators.jets.tank
    }
}
