//! Deterministic in-process simulation of the whole node set.
//!
//! The same node cores as over DDS, joined by an event queue instead: same seed, same parameters,
//! same outputs to the bit, whatever the machine's load.

mod agenda;
mod bus;
mod link;
mod node_set;
mod run;

pub use bus::{Bus, Observer};
pub use link::{Cut, Host, LinkParameters};
pub use node_set::{NodeSet, NodeSetError, ask_simulation};
pub use run::{Outcome, run};
