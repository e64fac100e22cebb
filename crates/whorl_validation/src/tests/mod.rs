//! On simulated recordings.

mod comparisons;
#[path = "../../../whorl_prediction/src/tests/generator.rs"]
mod generator;
mod localisation;
mod memory;
mod pendulums;
mod rigs;
mod statistics;
