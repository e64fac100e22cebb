//! An effect as data: what a file of an effect says.

use super::{Axes, CurveShape};
use crate::effects::Role;

/// What the number or vector that an equation gives is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ActsOn {
    /// The torque on the body [N m], a vector.
    #[default]
    Torque,
    /// The torque on each wheel about its axis [N m], a number; the body takes the opposite.
    WheelTorque,
    /// The thrust of every jet, as a share of what it would be: 0.05 is 5 % more, a number.
    Thrust,
    /// The gyro's true input [rad/s], a vector.
    Gyro,
    /// The accelerometer's true input [m/s^2], a vector.
    Accelerometer,
}

impl ActsOn {
    /// Every one, with its name in files.
    pub const ALL: [(&'static str, Self); 5] = [
        ("torque", Self::Torque),
        ("wheel_torque", Self::WheelTorque),
        ("thrust", Self::Thrust),
        ("gyro", Self::Gyro),
        ("accelerometer", Self::Accelerometer),
    ];

    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, of)| *of == self).map_or("torque", |(name, _)| *name)
    }
}

/// A parameter of a written effect.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenParameter {
    /// Name in equations and parameter files.
    pub name: String,
    /// Unit in base units and their products, "1" for none.
    pub unit: String,
    /// Smallest and largest plausible value.
    pub range: (f64, f64),
    /// Value at which the effect is absent.
    pub neutral: f64,
    /// Prior standard deviation about `neutral`, > 0.
    pub prior: f64,
    /// What it does to the signal.
    pub role: Role,
    /// Known beforehand, never fitted.
    pub known: bool,
    /// Values of a shape from which a fit is tried; empty: some over its range.
    pub starts: Vec<f64>,
    /// A sentence.
    pub meaning: String,
}

/// A state of a written effect's own; it starts at zero.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenState {
    /// Name in equations.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Its derivative, an equation.
    pub derivative: String,
}

/// A measured curve of a written effect: a number over an expression.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenCurve {
    /// Name in equations; its coefficients are the parameters `NAME_1`, `NAME_2`, ...
    pub name: String,
    /// What it is over, an equation that gives a number.
    pub of: String,
    /// Unit of the knots.
    pub of_unit: String,
    /// Where its cubic pieces meet, increasing.
    pub knots: Vec<f64>,
    /// Unit of its value.
    pub unit: String,
    /// Largest plausible coefficient.
    pub largest: f64,
    /// Prior standard deviation of each coefficient.
    pub prior: f64,
    /// Shape that it must have.
    pub shape: CurveShape,
}

/// What a file of an effect says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Definition {
    /// Name in parameter files, reports and JSON: small letters, digits and `_`.
    pub id: String,
    /// A few words.
    pub title: String,
    /// A sentence: the mechanism and how it shows.
    pub explanation: String,
    /// What it is added to.
    pub acts_on: ActsOn,
    /// Axes of the vector that the equation gives; `None`: those of what it is made of, else the body's.
    pub axes: Option<Axes>,
    /// The equation.
    pub equation: String,
    /// Parameters.
    pub parameters: Vec<WrittenParameter>,
    /// States of its own.
    pub states: Vec<WrittenState>,
    /// Measured curves.
    pub curves: Vec<WrittenCurve>,
    /// It never does positive work.
    pub is_passive: bool,
    /// Whether local control counters it; `None`: unless it has states.
    pub is_fed_forward: Option<bool>,
    /// Where it comes from.
    pub source: String,
    /// Effects that typical data cannot tell from this one.
    pub confusable_with: Vec<String>,
    /// What separates it from those.
    pub separated_by: String,
}

/// Why a definition was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key}: {problem}")]
pub struct DefinitionError {
    /// Which entry, with dots: `parameters.k.unit`, `equation`.
    pub key: String,
    /// What is wrong, and what is allowed.
    pub problem: String,
}

impl DefinitionError {
    pub(super) fn new(key: impl Into<String>, problem: impl Into<String>) -> Self {
        Self { key: key.into(), problem: problem.into() }
    }
}
