//! What is made of simulated recordings.

pub mod generator;
mod refusals;
mod residual;
mod smoothed;
