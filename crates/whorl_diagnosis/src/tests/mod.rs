//! Whole diagnoses of simulated runs.

mod bad_input;
mod generator;
mod naming;
mod prospects;
mod whitening;
