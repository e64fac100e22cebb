//! Why data cannot be explained.

use thiserror::Error;
use whorl_identification::DiagnosisError;
use whorl_validation::ValidationError;

/// Why data cannot be explained, and what would help.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ExplainError {
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
        error: Box<DiagnosisError>,
    },
    /// What changed needs runs to compare.
    #[error("a history needs at least two runs")]
    TooFewRuns,
    /// The platform is clamped, no manoeuvre can be simulated, or every one exceeds the platform's limits.
    #[error("no manoeuvre can be proposed: {0}")]
    NoManoeuvre(String),
}
