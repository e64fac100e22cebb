//! `std_msgs`.

use serde::{Deserialize, Serialize};

use crate::builtin_interfaces::Time;

/// Measurement stamp and frame.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Header {
    pub stamp: Time,
    pub frame_id: String,
}
