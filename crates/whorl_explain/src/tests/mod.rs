//! On simulated runs, of which the answer is known.

mod agreement;
#[path = "../../../whorl_trajectory/src/tests/generator.rs"]
mod generator;
mod located;
