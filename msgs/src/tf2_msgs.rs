//! `tf2_msgs`.

use serde::{Deserialize, Serialize};

use crate::geometry_msgs::TransformStamped;

/// Frames and where they are.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct TFMessage {
    pub transforms: Vec<TransformStamped>,
}
