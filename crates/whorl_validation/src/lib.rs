//! Comparison of a model with data: prediction errors, what is left of them, and the quantities that it depends on.
//!
//! [`compare`] predicts a recording at several horizons and tests what is left.
//! [`unexplained_torques`] smooths what pushed the platform beside its model, [`dependence`] finds the recorded quantities on which that
//! depends, and [`explain_where`] puts the result into words.

pub mod comparison;
pub mod dependence;
mod error;
mod followed;
mod localisation;
mod remarks;
pub mod statistics;
#[cfg(test)]
mod tests;
mod unexplained;

pub use comparison::{Comparison, SMALL_ERROR, compare, compare_as, prediction_error};
pub use error::ValidationError;
pub use localisation::{Localisation, OfMotor, WithTorques, explain_where};
pub use unexplained::{UnexplainedTorques, unexplained_torques};
