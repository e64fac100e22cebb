//! Records every topic into a run directory.
//!
//! - [`RecorderCore`]: takes samples, ticks and the end, and writes to a [`Sink`]; knows no files, clocks,
//!   threads or network. The sink of the program is [`whorl_bag::RunWriter`].
//! - [`ReportingCore`]: the node that publishes the status of the recording.
//! - `main.rs`: the shell. A thread receives raw CDR, so that messages are recorded exactly as they were sent,
//!   also of types that Whorl does not know.

mod core;
pub mod parameters;
mod reporting;
mod sink;
#[cfg(test)]
mod tests;
mod topics;

pub use crate::core::{RecorderCore, Status};
pub use parameters::Parameters;
pub use reporting::ReportingCore;
pub use sink::Sink;
pub use topics::RecordedTopic;
