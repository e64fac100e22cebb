//! Commands the formation: relative-attitude laws, experiment sequence, link watch.
//!
//! Reads every platform's `attitude/estimate` and `control/status`, publishes every platform's
//! `attitude/reference` (50 Hz), the heartbeat `/formation/command` (20 Hz), `/formation/state`
//! (10 Hz) and `/diagnostics`, and serves `/coordinator/start` and `/coordinator/abort`. It commands
//! references, never actuators. The README beside this crate has the state diagram.

mod clock;
mod core;
mod goal;
mod link;
pub mod parameters;
mod pause;
mod progress;
mod report;
mod run;
mod stage;

pub use crate::core::CoordinatorCore;
pub use parameters::Parameters;
