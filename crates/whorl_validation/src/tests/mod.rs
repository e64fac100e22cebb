//! On simulated recordings.

mod comparisons;
mod dependence;
#[path = "../../../whorl_prediction/src/tests/generator.rs"]
mod generator;
mod localisation;
mod memory;
mod pendulums;
mod quantities;
mod rigs;
mod statistics;
