//! On simulated recordings.

mod comparisons;
#[path = "../../../whorl_trajectory/src/tests/generator.rs"]
mod generator;
mod memory;
mod pendulums;
mod rigs;
mod statistics;
mod localisation;
