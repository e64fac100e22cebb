//! On simulated recordings.

mod comparisons;
#[path = "../../../whorl_trajectory/src/tests/generator.rs"]
mod generator;
mod statistics;
mod whereabouts;
