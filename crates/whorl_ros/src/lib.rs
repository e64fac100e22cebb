//! The only crate that knows ROS 2's transport: runs a node core on DDS.
//!
//! A node's whole `main` (a complete one is `examples/echo_node.rs`):
//!
//! ```text
//! fn main() -> ExitCode {
//!     let options = NodeOptions::new("estimator", "Estimates the attitude of one platform.");
//!     whorl_ros::run_node(options, |r| Some(Parameters::read(r)), |context, parameters| {
//!         Ok::<_, RosError>(Estimator::new(context.own_platform()?, parameters))
//!     })
//! }
//! ```
//!
//! [`run_node`] reads the command line ([`arguments`]), the environment ([`environment`]) and the
//! parameter files, then serves the core from one thread: messages as raw CDR, its timer, its
//! services, the six parameter services, `/rosout`, `/parameter_events`, `/diagnostics`,
//! `ros_discovery_info`, SIGINT and SIGTERM. It needs Linux.
//!
//! [`Participant`], [`RawReader`] and [`RawWriter`] are for programs that are not cores: the
//! recorder and `whorl` itself. [`recovery`] describes what happens after a network cut.

mod addresses;
pub mod arguments;
mod clock;
mod connection;
mod context;
mod endpoints;
pub mod environment;
mod error;
mod graph;
mod handshakes;
mod launcher;
mod listener;
mod log;
mod memory;
pub mod names;
mod node;
mod nudge;
mod parameter_client;
mod parameter_wire;
mod parameters;
mod participant;
mod peers;
mod raw;
pub mod recovery;
mod relay;
mod requests;
mod runner;
mod security;
mod services;
mod shell;
mod sole;
mod statistics;
mod wake;
mod watchdog;
mod worker;

pub use addresses::AddressWatch;
pub use clock::{Clock, SET_BACK, monotonic, wall_clock};
pub use context::{NodeContext, NodeOptions, WRONG_USAGE, context_from_command_line};
pub use error::RosError;
pub use graph::{Announcement, NodeList};
pub use handshakes::Handshakes;
pub use launcher::end_with_launcher;
pub use listener::AmbientNetwork;
pub use log::to_stderr as log_to_stderr;
pub use memory::limit_memory;
pub use node::run_node;
pub use parameter_client::{ParameterClient, ParameterClientError, ParameterDescription};
pub use participant::{DiscoveredEndpoint, EndpointQos, Participant};
pub use peers::{ParticipantPrefix, PeerEvent};
pub use raw::{EndpointId, RawReader, RawSample, RawWriter};
pub use security::SecurityRefusal;
pub use services::ServiceClient;
pub use statistics::{LATE_TIMERS, LOST_MESSAGES, SECOND_PUBLISHER};
pub use wake::Continued;
