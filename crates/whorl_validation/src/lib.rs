//! How far a model is from the data, against which noise, and on what the difference depends.
//!
//! [`compare`] predicts a recording from smoothed initial states at several horizons and tests what is left.
//! [`dependence`] finds the recorded quantity on which a residual torque depends, and [`explain_where`] says so in
//! words.

pub mod comparison;
pub mod dependence;
mod error;
mod noise_floor;
mod prediction;
pub mod statistics;
#[cfg(test)]
mod tests;
mod whereabouts;

pub use comparison::{Comparison, compare};
pub use error::ValidationError;
pub use noise_floor::{FloorSource, NoiseFloor, NoiseFloors};
pub use prediction::{Prediction, Simulator};
pub use whereabouts::{Whereabouts, explain_where};
