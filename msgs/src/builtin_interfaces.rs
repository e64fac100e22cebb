//! `builtin_interfaces`.

use serde::{Deserialize, Serialize};

/// An instant: seconds since the epoch, rounded down, and nanoseconds (0..1e9) beyond.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Time {
    pub sec: i32,
    pub nanosec: u32,
}
