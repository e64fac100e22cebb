//! The node set in one simulated process.

mod accuracy;
mod after_2038;
mod determinism;
mod faults;
mod gyros;
mod link;
mod momentum;
