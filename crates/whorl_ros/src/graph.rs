//! Which node has which endpoints: what `ros2 node list` and `ros2 node info` read.
//!
//! <https://design.ros2.org/articles/Node_to_Participant_mapping.html>

use std::collections::{HashMap, HashSet};

use ros2_client::{
    Gid, NodeName as ClientNodeName,
    builtin_topics::ros_discovery,
    entities_info::{NodeEntitiesInfo, ParticipantEntitiesInfo},
};
use whorl_msgs::cdr;

use crate::error::RosError;
use crate::names::NodeName;
use crate::participant::{EndpointQos, Participant};
use crate::raw::{EndpointId, RawReader, RawWriter};

const TYPE: &str = "rmw_dds_common/msg/ParticipantEntitiesInfo";

pub(crate) fn writer(participant: &Participant) -> Result<RawWriter, RosError> {
    participant.dds_writer(ros_discovery::TOPIC_NAME, ros_discovery::TYPE_NAME, EndpointQos::DISCOVERY_INFO)
}

/// Announces the node of this process, or that there is none.
pub(crate) fn announce(
    writer: &RawWriter,
    participant: EndpointId,
    node: Option<&NodeName>,
    readers: impl Iterator<Item = EndpointId>,
    writers: impl Iterator<Item = EndpointId>,
) -> Result<(), RosError> {
    let gid = |id: EndpointId| Gid::from(id.0);
    let mut nodes = Vec::new();
    if let Some(node) = node {
        let name = ClientNodeName::new(node.namespace(), node.base())
            .map_err(|e| RosError::dds("announcing the node", e))?;
        let mut entities = NodeEntitiesInfo::new(name);
        readers.for_each(|id| entities.add_reader(gid(id)));
        writers.for_each(|id| entities.add_writer(gid(id)));
        nodes.push(entities);
    }
    let info = ParticipantEntitiesInfo::new(gid(participant), nodes);
    writer.publish(&cdr::encode(TYPE, &info)?)
}

/// Tells whose the readers of a participant are that is not a node's own, for `ros2 topic info --verbose`: those of a node whose
/// name begins with an underscore, which ROS 2 does not list.
pub struct Announcement(
    #[expect(dead_code, reason = "what it wrote is known as long as it lives")] RawWriter,
);

impl Announcement {
    /// Of readers that belong to `node`: for `/recorder` and `bag` they are those of `/_recorder_bag`.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(
        participant: &Participant,
        node: &NodeName,
        part: &str,
        readers: impl Iterator<Item = EndpointId>,
    ) -> Result<Self, RosError> {
        let hidden = NodeName::new(node.namespace(), &format!("_{}_{part}", node.base()))?;
        let writer = writer(participant)?;
        announce(&writer, participant.id(), Some(&hidden), readers, std::iter::empty())?;
        Ok(Self(writer))
    }
}

/// Reads the other nodes on the network, for `whorl`'s list of nodes.
pub struct NodeList {
    reader: RawReader,
    by_participant: HashMap<Gid, Vec<String>>,
}

impl NodeList {
    /// Starts listening.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(participant: &Participant) -> Result<Self, RosError> {
        let reader = participant.dds_reader(
            ros_discovery::TOPIC_NAME,
            ros_discovery::TYPE_NAME,
            EndpointQos::DISCOVERY_INFO,
        )?;
        Ok(Self { reader, by_participant: HashMap::new() })
    }

    /// Full names of the nodes on the network, sorted.
    ///
    /// # Errors
    /// When DDS fails.
    pub fn nodes(&mut self, participant: &Participant) -> Result<Vec<String>, RosError> {
        self.reader.drain_notifications();
        while let Some(sample) = self.reader.take()? {
            // Samples of other vendors that we cannot read are not listed.
            if let Ok(info) = cdr::decode::<ParticipantEntitiesInfo>(TYPE, &sample.bytes) {
                let names = info.nodes().iter().map(NodeEntitiesInfo::fully_qualified_name).collect();
                self.by_participant.insert(info.gid(), names);
            }
        }
        // A killed process did not say goodbye; DDS notices after its lease.
        let mut alive: HashSet<_> =
            participant.discovered_writers().iter().map(|w| w.endpoint.participant()).collect();
        alive.insert(participant.id().participant());
        self.by_participant.retain(|gid, _| alive.contains(&EndpointId(gid.to_bytes16()).participant()));
        let listed = |name: &&String| !name.contains("/_");
        let mut names: Vec<_> = self.by_participant.values().flatten().filter(listed).cloned().collect();
        names.sort();
        names.dedup();
        Ok(names)
    }
}
