//! Lists with one entry per jet, motor or axis: counted and in range.

/// Why a list is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ListError {
    /// A list does not have one entry per jet, motor or axis.
    #[error("{field} has {found} entries where {expected} are needed")]
    Count {
        /// The list.
        field: &'static str,
        /// Its length.
        found: usize,
        /// The length that is needed.
        expected: usize,
    },
    /// A number is NaN, infinite or outside its range.
    #[error("{field}[{index}] = {value}: must be {allowed}")]
    Value {
        /// The list.
        field: &'static str,
        /// Which jet, motor or axis; 0 for a single number.
        index: usize,
        /// The offending number.
        value: f64,
        /// What is allowed, in words.
        allowed: &'static str,
    },
}

/// The length that is needed.
pub(crate) fn check_count(field: &'static str, found: usize, expected: usize) -> Result<(), ListError> {
    if found == expected { Ok(()) } else { Err(ListError::Count { field, found, expected }) }
}

/// The length that is needed, and every number valid.
pub(crate) fn check_list(
    field: &'static str,
    values: &[f64],
    expected: usize,
    valid: impl Fn(f64) -> bool,
    allowed: &'static str,
) -> Result<(), ListError> {
    check_count(field, values.len(), expected)?;
    match values.iter().enumerate().find(|(_, value)| !valid(**value)) {
        None => Ok(()),
        Some((index, &value)) => Err(ListError::Value { field, index, value, allowed }),
    }
}
