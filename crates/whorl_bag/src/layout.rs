//! Layout of a run directory.

/// The bag in a run directory.
pub const BAG_DIRECTORY: &str = "bag";
/// The parameter files in a run directory.
pub const PARAMETER_DIRECTORY: &str = "params";
/// Headline numbers in a run directory.
pub const SUMMARY_FILE: &str = "summary.json";
