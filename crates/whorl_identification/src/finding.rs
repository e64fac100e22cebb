//! What a user must know about data or results, and why a recording cannot be used, in sentences.

use thiserror::Error;
use whorl_prediction::PredictionError;
use whorl_prediction::Refusal;
use whorl_validation::ValidationError;

/// Why recordings cannot be used at all.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DataError {
    /// A recording cannot be used.
    #[error(transparent)]
    Recording(#[from] Refusal),
    /// A recording cannot be predicted with the model.
    #[error(transparent)]
    Prediction(#[from] PredictionError),
    /// A recording cannot be compared with the model.
    #[error(transparent)]
    Comparison(#[from] ValidationError),
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
