//! What a user must know about data or results, in sentences.

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
