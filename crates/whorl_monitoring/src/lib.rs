//! Whether a platform still moves as its model says, while it moves: its plant goes along, a filter makes innovations of what is read otherwise, and
//! these are evidence for or against every effect that may have begun (equations: METHOD.md here). All is pure: time and data are arguments.

mod cell;
mod directions;
mod evidence;
mod fit;
mod monitor;
mod sources;
#[cfg(test)]
mod tests;
mod watch;

pub use fit::{Fit, Likeliest, Settings, State};
pub use monitor::Monitor;
pub use whorl_recording::Channel;
