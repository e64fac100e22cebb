//! Whole diagnoses of simulated runs.

mod bad_input;
mod expected_information;
pub(crate) mod generator;
mod gyros;
mod initial_guesses;
mod low_pass;
mod memory;
mod naming;
mod noise_walks;
mod residual;
mod slopes;
mod starts;
mod ties;
mod touches;
mod trace;
mod uncertainty;
mod whitening;
