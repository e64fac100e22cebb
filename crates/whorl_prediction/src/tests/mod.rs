//! Tests on simulated recordings.

#[allow(dead_code, reason = "tests of other crates use the rest")]
pub mod generator;
mod refusals;
mod stop;
