//! Comparison of a model with data: prediction errors, what is left of them, and the quantities that it depends on.
//!
//! [`compare`] predicts a recording at several horizons and tests what is left. [`unexplained_torques`] smooths what pushed the platform beside
//! its model, and [`explain_where`] says on which of the recorded [`quantities()`] that depends, and by which of the [`SHAPES`].

pub mod comparison;
mod dependence;
mod localisation;
mod quantities;
mod remarks;
mod shapes;
#[cfg(test)]
mod tests;
mod unexplained;

pub use comparison::{Comparison, SMALL_ERROR, compare, prediction_error};
pub use dependence::{Curves, Dependence, Dependences, Frame};
pub use localisation::{Localisation, OfMotor, explain_where};
pub use quantities::{Quantity, environment, quantities};
pub use shapes::{Growth, OF_DIAGNOSIS, Parity, SHAPES, Shape};
pub use unexplained::{UnexplainedTorques, unexplained_torques};
