//! Tests on simulated recordings.

pub mod generator;
mod refusals;
mod residual;
mod smoothed;
