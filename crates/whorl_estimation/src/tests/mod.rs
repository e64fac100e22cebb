//! Tests of the whole filter against a truth that shares no code with it.

mod accuracy;
mod gates;
mod recovery;
pub(crate) mod simulation;
