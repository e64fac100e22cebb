//! Whole diagnoses of simulated runs.

mod bad_input;
mod expected_information;
pub(crate) mod generator;
mod gyros;
mod low_pass;
mod naming;
mod ties;
mod touches;
mod trace;
mod uncertainty;
