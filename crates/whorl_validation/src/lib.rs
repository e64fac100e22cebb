//! Comparison of a model with data: prediction errors, what is left of them, and the quantities that it depends on.
//!
//! [`compare`] predicts a recording at several horizons and tests what is left.
//! [`dependence`] finds the recorded quantities on which a residual torque depends, and [`explain_where`] puts the
//! result into words.

pub mod comparison;
pub mod dependence;
mod error;
pub mod statistics;
#[cfg(test)]
mod tests;
mod whereabouts;

pub use comparison::{Comparison, compare};
pub use error::ValidationError;
pub use whereabouts::{Whereabouts, explain_where};
