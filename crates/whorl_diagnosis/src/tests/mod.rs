//! Whole diagnoses of simulated runs.

mod generator;
mod naming;
mod whitening;
