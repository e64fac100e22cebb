//! The one place where stamps of other nodes become this node's time.

use whorl_msgs::builtin_interfaces::Time;
use whorl_node::Timestamp;

/// Clock of the sender of a platform's messages.
///
/// All nodes run on one host now, so it is the same clock. Platforms on their own computers get an
/// offset here, measured by the nodes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SenderClock;

impl SenderClock {
    /// A stamp of the sender, in this node's time.
    pub fn to_local(self, stamp: Time) -> Timestamp {
        Timestamp::from(stamp)
    }
}
