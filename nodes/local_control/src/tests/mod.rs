//! Tests of the core, closed over the truth plant.

mod adoption;
mod balancing;
mod determinism;
mod exciting;
mod gating;
mod kinds;
mod pointing;
mod responses;
mod rig;
