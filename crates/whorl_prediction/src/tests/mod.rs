//! Tests on simulated recordings.

mod differences;
#[allow(dead_code, reason = "tests of other crates use the rest")]
pub mod generator;
mod recursive;
mod stop;
mod supplies;
