//! Descriptions of a node's parameters, for the ROS 2 parameter services and for the record of a run.

use crate::value::{Kind, Value};

/// A range for the ROS 2 parameter services, ends included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NumericRange {
    /// `rcl_interfaces/msg/FloatingPointRange`; open ends are infinite.
    Double {
        /// Smallest allowed value.
        from: f64,
        /// Largest allowed value.
        to: f64,
    },
    /// `rcl_interfaces/msg/IntegerRange`; open ends are the limits of i64.
    Integer {
        /// Smallest allowed value.
        from: i64,
        /// Largest allowed value.
        to: i64,
    },
}

/// One parameter of a node, as it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Descriptor {
    /// Full key with dots.
    pub name: String,
    /// Its type.
    pub kind: Kind,
    /// The value in force, defaults included; `None` for an optional parameter that is not set.
    pub value: Option<Value>,
    /// The value that is in force when none is given.
    pub default: Option<Value>,
    /// Whether a value must be given.
    pub required: bool,
    /// What it means, with its unit.
    pub doc: String,
    /// What is allowed, in words.
    pub allowed: String,
    /// Allowed numbers (of each element, for lists).
    pub range: Option<NumericRange>,
    /// Allowed texts; empty = any.
    pub choices: Vec<String>,
    /// True when it can only be set at the start of the node.
    pub read_only: bool,
}
