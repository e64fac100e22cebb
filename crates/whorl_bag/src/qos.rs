//! Quality of service as rosbag2 records it.

use whorl_msgs::topics::Qos;

/// `rmw` writes an unlimited duration like this.
const INFINITE: &str = "sec: 9223372036\n  nsec: 854775807";

/// The profile list of metadata version 9 (enumerators by name), as rosbag2 stores it in the channel
/// metadata `offered_qos_profiles`. Deadline, lifespan and lease are unlimited, durability volatile.
#[must_use]
pub fn offered_qos_profiles(qos: Qos) -> String {
    let reliability = if qos.reliable { "reliable" } else { "best_effort" };
    let unlimited = INFINITE.replace("\n  ", "\n    ");
    format!(
        "- history: keep_last\n  depth: {}\n  reliability: {reliability}\n  durability: volatile\n  \
         deadline:\n    {unlimited}\n  lifespan:\n    {unlimited}\n  liveliness: automatic\n  \
         liveliness_lease_duration:\n    {unlimited}\n  avoid_ros_namespace_conventions: false\n",
        qos.depth
    )
}
