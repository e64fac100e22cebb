//! Tests on simulated runs with a known answer.

mod agreement;
mod agreement_of_values;
mod driven;
#[path = "../../../whorl_prediction/src/tests/generator.rs"]
mod generator;
mod located;
mod refits;
mod trends;
