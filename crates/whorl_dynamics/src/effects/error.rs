//! Errors of effects.

use thiserror::Error;

/// Why a set of effects was refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EffectError {
    /// No effect of the catalogue has this id.
    #[error("there is no effect `{name}`; nearest: {}", nearest.join(", "))]
    UnknownEffect {
        /// What was asked for.
        name: String,
        /// The ids nearest to it.
        nearest: Vec<String>,
    },
    /// The effect has no such parameter on this platform.
    #[error("effect `{effect}` has no parameter `{name}` on this platform; it has: {}", nearest.join(", "))]
    UnknownParameter {
        /// The effect.
        effect: &'static str,
        /// What was asked for.
        name: String,
        /// Names it has, nearest first.
        nearest: Vec<String>,
    },
    /// A value is NaN, infinite or outside its range.
    #[error("effect `{effect}`: {name} = {value} {unit} is outside {min} .. {max} {unit}")]
    OutOfRange {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        name: String,
        /// The refused value.
        value: f64,
        /// Unit of the value and the range.
        unit: &'static str,
        /// Smallest value allowed.
        min: f64,
        /// Largest value allowed.
        max: f64,
    },
    /// These values make the platform physically impossible.
    #[error("effect `{effect}` with these values makes a platform that cannot exist: {reason}")]
    NotPhysical {
        /// The effect.
        effect: &'static str,
        /// What is impossible.
        reason: String,
    },
    /// More hidden states than the integrator holds.
    #[error("these effects need {needed} hidden states; {available} are available")]
    TooManyHiddenStates {
        /// Number needed.
        needed: usize,
        /// Number available.
        available: usize,
    },
}
