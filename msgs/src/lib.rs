//! ROS 2 messages of Whorl as Rust types, their `.msg` definitions, CDR encoding and the table of
//! topics.
//!
//! `msg/` and `srv/` are a real ROS 2 interface package: build it with colcon to use the messages
//! from C++ or Python. `standard/` holds the standard messages in use, so that recordings carry
//! complete schemas. From these files `build.rs` makes the Rust types, [`definitions::DEFINITIONS`]
//! and the list behind [`Message`]: a new message is its file, and a row in [`topics`].
//!
//! Unit, frame and invalid value of every field stand in its definition, and are its documentation here.

include!(concat!(env!("OUT_DIR"), "/packages.rs"));

mod actuators;
pub mod bounds;
pub mod cdr;
#[cfg(test)]
mod conformity;
pub mod definitions;
mod extensions;
pub mod fields;
#[cfg(test)]
#[path = "../build/parse.rs"]
mod parse;
#[cfg(test)]
mod parse_tests;
pub mod topics;

pub use topics::{Message, MessageType, PlatformId, Route, Service, Topic};
