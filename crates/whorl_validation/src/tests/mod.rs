//! On simulated recordings.

mod comparisons;
#[path = "../../../whorl_trajectory/src/tests/generator.rs"]
mod generator;
mod memory;
mod rigs;
mod statistics;
mod whereabouts;
