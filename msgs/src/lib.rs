//! ROS 2 messages of Whorl as Rust types, their `.msg` definitions, CDR encoding and the table of
//! topics.
//!
//! `msg/` and `srv/` are a real ROS 2 interface package: build it with colcon to use the messages
//! from C++ or Python. `standard/` holds the field lists of the standard messages in use, so that
//! recordings carry complete schemas. A test parses every definition and compares it with the Rust
//! type field by field.
//!
//! Field documentation (unit, frame, invalid value) stands in the `.msg` files.

mod actuators;
pub mod builtin_interfaces;
pub mod cdr;
#[cfg(test)]
mod conformity;
pub mod definitions;
pub mod diagnostic_msgs;
pub mod geometry_msgs;
pub mod sensor_msgs;
pub mod std_msgs;
pub mod tf2_msgs;
pub mod topics;
pub mod whorl;

pub use topics::{Message, MessageType, PlatformId, Route, Service, Topic};
