//! Findings about a recording, in sentences.

use thiserror::Error;
use whorl_trajectory::Refusal;

/// Why a recording cannot be used at all.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DataError {
    /// The recording cannot be used.
    #[error(transparent)]
    Recording(#[from] Refusal),
    /// The model is not a possible platform.
    #[error("the model cannot be simulated: {0}")]
    Model(String),
    /// The data contradict the model in a known way.
    #[error("{0}")]
    Refused(String),
    /// The fit did not succeed.
    #[error("the fit did not converge: {0}")]
    NotConverged(String),
}

/// Something a user must know about the data or the result: one plain sentence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Whether the result must not be used because of it.
    pub fatal: bool,
    /// The sentence.
    pub text: String,
}

impl Finding {
    /// A warning.
    #[must_use]
    pub fn warning(text: String) -> Self {
        Self { fatal: false, text }
    }

    /// A reason not to use the result.
    #[must_use]
    pub fn fatal(text: String) -> Self {
        Self { fatal: true, text }
    }
}
