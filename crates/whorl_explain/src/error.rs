//! Why data cannot be explained.

use thiserror::Error;
use whorl_identification::DiagnosisError;
use whorl_prediction::Refusal;
use whorl_validation::ValidationError;

/// Why data cannot be explained, and what would help.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ExplainError {
    /// A recording cannot be used.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// A recording cannot be compared with the model.
    #[error(transparent)]
    Validation(#[from] ValidationError),
    /// The recordings cannot be diagnosed.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// A version of the model cannot be fitted.
    #[error("cannot fit {version}: {error}")]
    Fit {
        /// Which version.
        version: String,
        /// Why not.
        error: DiagnosisError,
    },
    /// A history needs runs to compare.
    #[error("a history needs at least two runs")]
    TooFewRuns,
    /// Manoeuvres are designed for platforms on their bearing.
    #[error(
        "all runs are of a clamped platform, and manoeuvres are designed for a free one: for a bench test let every wheel coast down from full speed to both sides, then brake it through zero"
    )]
    Clamped,
    /// A manoeuvre cannot be simulated.
    #[error("cannot simulate the manoeuvre {name}: {reason}")]
    Rehearsal {
        /// The manoeuvre.
        name: String,
        /// Why not.
        reason: String,
    },
    /// Every manoeuvre exceeds the platform's limits.
    #[error("no manoeuvre stays within the platform's limits: {0}")]
    NoManoeuvre(String),
}
