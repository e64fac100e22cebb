//! The node set in one simulated process.

mod accuracy;
mod determinism;
mod faults;
mod gyros;
mod link;
mod momentum;
