//! Starts, watches and stops the processes of an experiment on this machine.
//!
//! - [`Setup`]: which experiment, platforms and parameter files; checked before anything starts.
//! - [`Process`]: what is started, with its arguments, as data made by [`Setup`] from the table of nodes.
//! - [`Domain`]: the ROS domain on this machine: which experiment uses it, and which processes run in it.
//! - [`Supervisor`]: the running processes; stops them, the recorder last.
//!
//! The user's commands, `whorl run` and `whorl nodes`, are in the command line crate.

mod domain;
mod error;
mod process;
mod realtime;
mod restarts;
mod setup;
mod step;
mod supervisor;
#[cfg(test)]
mod tests;

pub use domain::{Domain, Lease};
pub use error::LaunchError;
pub use process::{Process, Programs};
pub use realtime::RealTime;
pub use restarts::Restarts;
pub use setup::{Backend, DriverSource, Setup, SetupOptions, find_experiment};
pub use step::run_to_end;
pub use supervisor::{Ended, Stopped, Supervisor, become_node, by_accident, ends_with_this_process};
