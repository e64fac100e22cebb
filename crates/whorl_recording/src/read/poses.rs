//! Attitudes in messages of other systems.

use nalgebra::{Quaternion, UnitQuaternion};
use whorl_msgs::cdr::{CdrError, decode};
use whorl_msgs::geometry_msgs::{PoseStamped, TransformStamped};
use whorl_node::Timestamp;

/// The types that can be read.
pub(super) const TYPES: [&str; 3] =
    ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped", "nav_msgs/msg/Odometry"];

/// An attitude, and when it was.
#[derive(Debug)]
pub(super) struct SeenPose {
    pub stamp: Timestamp,
    pub frame_id: String,
    /// `None` where the numbers are no rotation.
    pub q_world_body: Option<UnitQuaternion<f64>>,
}

pub(super) fn read(type_name: &str, cdr: &[u8]) -> Result<SeenPose, CdrError> {
    let [pose, transform, _] = TYPES;
    let (header, q) = if type_name == pose {
        let m: PoseStamped = decode(pose, cdr)?;
        (m.header, m.pose.orientation)
    } else {
        // An Odometry begins as a TransformStamped does: header, child frame, three numbers, quaternion.
        let m: TransformStamped = decode(transform, cdr)?;
        (m.header, m.transform.rotation)
    };
    let q = Quaternion::new(q.w, q.x, q.y, q.z);
    // Zeros stand for an attitude that is not known.
    let is_rotation = (q.norm() - 1.0).abs() < 0.1;
    Ok(SeenPose {
        stamp: header.stamp.into(),
        frame_id: header.frame_id,
        q_world_body: is_rotation.then(|| UnitQuaternion::from_quaternion(q)),
    })
}
