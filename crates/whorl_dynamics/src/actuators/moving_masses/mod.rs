//! Linear mass actuators: masses that are moved along the body axes to change the gravity offset.
//!
//! Every platform may have them; they are commanded by the moment that they add to the gravity offset and have no
//! parameters of their own yet.

mod dynamics;

pub use dynamics::State;
pub(crate) use dynamics::{Drive, Forces};

use super::{ActuatorError, ActuatorKind, Field, Group, KindPrior};

/// The linear mass actuators of a platform.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MovingMasses;

impl ActuatorKind for MovingMasses {
    fn groups(&self) -> &'static [Group] {
        &[]
    }

    fn add(&mut self, _name: String) {}

    fn names(&self) -> Vec<&str> {
        Vec::new()
    }

    fn fields(&mut self, _group: usize, _member: usize) -> Vec<Field<'_>> {
        Vec::new()
    }

    fn check(&self) -> Result<(), ActuatorError> {
        Ok(())
    }
}

/// They have no uncertainty: their initial position is part of the gravity offset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MovingMassPriors;

impl MovingMassPriors {
    pub(super) fn typical(_masses: &MovingMasses) -> Self {
        Self
    }
}

impl KindPrior for MovingMassPriors {
    fn keys(&self) -> &'static [&'static str] {
        &[]
    }

    fn stddev(&self, _key: &str, _member: usize) -> Option<f64> {
        None
    }

    fn set_stddev(&mut self, _key: &str, _member: usize, _stddev: f64) {}
}
