//! The contract between a node's pure core and the shells that run it.
//!
//! A core is a state machine: [`NodeCore::step`] takes the time and one [`Event`] and appends
//! messages and log lines to [`Outputs`]. It knows no ROS, clock, file, thread or randomness.
//! Three shells run the same cores unchanged: `whorl_ros` (DDS, real time), `whorl_sim`
//! (one process, simulated time) and replay. [`nodes`] is the table of all nodes.

mod foreign;
pub mod nodes;
mod outputs;
mod repeats;
mod timestamp;

pub use foreign::{ForeignNetwork, ForeignSample, ForeignTopic, ForeignTopics, TransportError};
pub use nodes::{Node, NodeInfo, NodeInstance, Place, node_set};
pub use outputs::{LogLevel, LogLine, Outputs, Publication, Response};
pub use repeats::Repeats;
pub use timestamp::Timestamp;
pub use whorl_msgs::topics::{Message, Route, Service, Topic};

use std::time::Duration;

/// Where traffic is secured, the DDS library stands still for this long whenever two of its threads want the same lock
/// (docs/upstream/rustdds.md): deadlines of messages between the nodes of a platform are longer by one such stall there.
pub const SECURED_STALL: Duration = Duration::from_millis(100);

/// What happened to a node.
#[derive(Debug, Clone, PartialEq)]
pub enum Event<'a> {
    /// A message arrived on one of the core's subscriptions.
    Message {
        /// The topic and, for a topic in a platform's namespace, which platform.
        route: Route,
        /// The message itself.
        message: &'a Message,
    },
    /// The core's periodic timer fired; see [`NodeCore::timer_period`]. The n-th firing is due at
    /// start + n * period; a late shell fires late but never skips.
    Timer,
    /// What the core drives has something for it, between two firings of its timer.
    Woken,
    /// Somebody called one of the core's services; answer with [`Outputs::respond`].
    Request {
        /// Which one; always one of [`NodeCore::services`].
        service: Service,
        /// The request's only field (experiment name, reason); may be empty.
        argument: &'a str,
    },
    /// The shell will be away for a while, up to seconds: it joins the network anew. Whoever drives something commands a
    /// safe state first.
    Interruption,
    /// The shell is stopping (Ctrl-C, SIGTERM): the last chance to command a safe state.
    Shutdown,
}

/// A node without its transport.
pub trait NodeCore: Send {
    /// Topics the core reads. `Route::platform` is an index into the list of platforms.
    fn subscriptions(&self) -> Vec<Route>;

    /// Topics the core writes.
    fn publications(&self) -> Vec<Route>;

    /// Period of [`Event::Timer`]; `None` for a core that only answers messages.
    fn timer_period(&self) -> Option<Duration>;

    /// Services that the core offers.
    fn services(&self) -> &'static [Service] {
        &[]
    }

    /// Advances the state machine by one event.
    ///
    /// `now` is the node's own time: it begins at the computer's time of day and then runs with its monotonic clock, so
    /// that it never decreases and never jumps, whoever sets the computer's clock. Deadlines, ages and timeouts are
    /// counted in it. Stamps of messages are the same time: the shell translates them where they come in and go out.
    fn step(&mut self, now: Timestamp, event: Event<'_>, outputs: &mut Outputs);

    /// True once the node has finished its task; a shell may then stop it.
    fn finished(&self) -> bool {
        false
    }

    /// Why the node's task failed, once it has [`Self::finished`] without success: the program's exit status says so.
    fn failure(&self) -> Option<String> {
        None
    }
}

/// A core that can be built from, and reconfigured with, validated parameters.
pub trait Configurable: NodeCore + Sized {
    /// Validated parameters, as read from YAML by `whorl_params`.
    type Parameters: Clone + Send;

    /// Applies changed parameters to the running core (`ros2 param set`).
    ///
    /// # Errors
    /// The reason, in words, why these parameters cannot be changed while the node runs. The
    /// core is then unchanged.
    fn reconfigure(&mut self, parameters: &Self::Parameters) -> Result<(), String>;
}
