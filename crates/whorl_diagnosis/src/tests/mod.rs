//! Whole diagnoses of simulated runs.

mod bad_input;
mod initial_guesses;
pub(crate) mod generator;
mod gyros;
mod low_pass;
mod memory;
mod naming;
mod noise_walks;
mod expected_information;
mod residual;
mod slopes;
mod starts;
mod ties;
mod trace;
mod uncertainty;
mod whitening;
