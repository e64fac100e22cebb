//! The description of a kind of actuator.

use std::fmt;

use nalgebra::Vector3;
use thiserror::Error;

use super::{Field, Joints, Motor};

/// A group of entries in parameter files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Any number of actuators, each under a name of the user's choice.
    Members {
        /// Name of the group.
        name: &'static str,
        /// Name of the group of values that its members share.
        defaults: &'static str,
    },
    /// Entries of the kind as a whole; may be left out as a whole.
    One {
        /// Name of the group.
        name: &'static str,
    },
}

impl Group {
    /// Name of the group.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Members { name, .. } | Self::One { name } => name,
        }
    }
}

/// The actuators of one kind on one platform: what they are made of, and how that stands in parameter files.
pub trait ActuatorKind: fmt::Debug {
    /// Its groups in parameter files.
    fn groups(&self) -> &'static [Group];

    /// Adds an actuator to a group of members. Its entries have no meaning until they are set.
    fn add(&mut self, name: String);

    /// How many actuators it has.
    fn count(&self) -> usize;

    /// The names of its actuators, in the order of every array in messages.
    fn names(&self) -> Vec<&str>;

    /// The entries of a member of a group of [`Self::groups`], or of the kind as a whole (`member` is then of no
    /// concern), in the order of parameter files. Empty when there is no such member.
    fn fields(&mut self, group: usize, member: usize) -> Vec<Field<'_>>;

    /// Whether every actuator is valid and can be simulated.
    ///
    /// # Errors
    /// The first that is not.
    fn check(&self) -> Result<(), ActuatorError>;

    /// How control reaches its motors; `None` for a kind without any.
    fn channel(&self) -> Option<MotorChannel> {
        None
    }

    /// What its motors, one per actuator, can do now; `effects` is what effects give each part besides friction, in
    /// the unit of its command.
    fn motors(&self, _joints: &Joints, _effects: &[f64], _motors: &mut [Motor]) {}

    /// Commands that its motors should have for their own sake, as far as the torque on the body leaves them free, in
    /// the unit of each command: zero unless a kind says otherwise.
    fn prefer(&self, _joints: &Joints, preferred: &mut [f64]) {
        preferred.fill(0.0);
    }

    /// Whether the direction of its motors' torque changes as they move, so that all may come to lie in one plane.
    fn may_be_singular(&self) -> bool {
        false
    }

    /// Momentum that its moving parts have relative to the body, body axes [N m s].
    fn momentum_b_n_m_s(&self, _joints: &Joints) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// The part of that momentum's rate that their motors make, body axes [N m]; `effort` is the measured torque of
    /// each motor about its axis [N m].
    fn momentum_rate_b_n_m(&self, _joints: &Joints, _effort: &[f64]) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Noise of that momentum, per axis, when speeds are measured with this one [N m s].
    fn momentum_noise_n_m_s(&self, _speed_noise_rad_s: f64) -> f64 {
        0.0
    }
}

/// Channels by which a kind's motors are commanded and measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MotorChannel {
    /// Field of the actuator command message that holds one command per motor.
    pub command_field: &'static str,
    /// Topic of the joint states of its moving parts, in the platform's namespace.
    pub state_topic: &'static str,
    /// Whether the positions of these matter, besides their speeds.
    pub needs_position: bool,
}

/// How well the actuators of one kind are known, for fits to start from: of a number the standard deviation as a
/// share of its value, or in its unit, of a direction about each of two axes across it \[rad\].
pub trait KindPrior: fmt::Debug {
    /// Keys of the entries that fits estimate, of each member of the first group.
    fn keys(&self) -> &'static [&'static str];

    /// Whether the deviation of a number is a share of its value; of one that may be zero it is in its unit.
    fn is_share(&self, _key: &str) -> bool {
        true
    }

    /// Standard deviations of an entry, by actuator; `None` when fits take that entry as known.
    fn stddevs(&self, key: &str) -> Option<&[f64]>;

    /// The same, to be changed.
    fn stddevs_mut(&mut self, key: &str) -> Option<&mut [f64]>;

    /// Standard deviation of one entry of one actuator; `None` when fits take that entry as known.
    fn stddev(&self, key: &str, member: usize) -> Option<f64> {
        self.stddevs(key)?.get(member).copied()
    }

    /// Changes it; does nothing when fits take that entry as known.
    fn set_stddev(&mut self, key: &str, member: usize, stddev: f64) {
        if let Some(slot) = self.stddevs_mut(key).and_then(|list| list.get_mut(member)) {
            *slot = stddev;
        }
    }
}

/// Why actuators cannot be simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ActuatorError {
    /// More than the integrator holds.
    #[error("{count} {kind}; at most {largest} can be simulated")]
    TooMany {
        /// Group of the kind.
        kind: &'static str,
        /// Actuators in the model.
        count: usize,
        /// Most that can be simulated.
        largest: usize,
    },
    /// Directions that must not depend on each other do.
    #[error(
        "the axes of {kind} lie along one line or in one plane; allowed: each an axis of its own, at most three"
    )]
    Dependent {
        /// Group of the kind.
        kind: &'static str,
    },
    /// A number that the dynamics divide by is not positive and finite.
    #[error("{what} must be positive and finite")]
    NotPositive {
        /// Which number.
        what: &'static str,
    },
}

/// Refuses more actuators than the integrator holds.
pub(super) fn check_count(kind: &'static str, count: usize, largest: usize) -> Result<(), ActuatorError> {
    if count > largest { Err(ActuatorError::TooMany { kind, count, largest }) } else { Ok(()) }
}

/// Refuses numbers that the dynamics cannot divide by.
pub(super) fn check_positive(
    numbers: impl IntoIterator<Item = (f64, &'static str)>,
) -> Result<(), ActuatorError> {
    for (number, what) in numbers {
        if !(number > 0.0 && number.is_finite()) {
            return Err(ActuatorError::NotPositive { what });
        }
    }
    Ok(())
}
