//! The shared group `formation`: which platforms there are.

use whorl_node::{NodeInstance, node_set};

use crate::error::ParameterErrors;
use crate::node_pattern::is_ros_name;
use crate::reader::Reader;
use crate::tree::ParameterTree;
use crate::value::Value;

/// The coordinator of the formation.
const COORDINATOR: &str = "/coordinator";

/// The platforms of the laboratory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Formation {
    /// Platform names, which are the ROS namespaces of their nodes. The order gives every
    /// platform its index.
    pub platforms: Vec<String>,
}

impl Formation {
    /// Index of a platform by name.
    #[must_use]
    pub fn index_of(&self, platform: &str) -> Option<usize> {
        self.platforms.iter().position(|name| name == platform)
    }

    /// Index of the platform that a node belongs to, by the node's fully qualified name:
    /// `/whorl_2/estimator` belongs to `whorl_2`.
    #[must_use]
    pub fn platform_of_node(&self, node: &str) -> Option<usize> {
        node.trim_start_matches('/').rsplit_once('/').and_then(|(namespace, _)| self.index_of(namespace))
    }
}

/// Reads the group `formation`.
pub fn formation(r: &mut Reader<'_>) -> Formation {
    r.claim_group("formation");
    r.group("formation", |r| {
        let platforms =
            r.string_array("platforms", "names of the platforms, which are the namespaces of their nodes");
        if let Some(bad) = platforms.iter().find(|name| !is_ros_name(name)) {
            r.reject(
                "platforms",
                format!("`{bad}` is not a ROS name; allowed: letters, digits and _, the first no digit"),
            );
        }
        let mut sorted: Vec<&String> = platforms.iter().collect();
        sorted.sort_unstable();
        let distinct = {
            sorted.dedup();
            sorted.len() == platforms.len()
        };
        if !distinct {
            r.reject("platforms", "a name stands twice; allowed: every platform once");
        }
        if platforms.is_empty() && r.has("platforms") {
            r.reject("platforms", "the list is empty; allowed: at least one platform");
        }
        Formation { platforms }
    })
}

/// Index and name of the platform that the reading node belongs to, by the node's namespace. `None`,
/// with the reason in the reader, when that namespace is not a platform of the formation.
pub fn own_platform(r: &mut Reader<'_>) -> Option<(u16, String)> {
    let formation = formation(r);
    let node = r.parameters().node().to_owned();
    let index = formation.platform_of_node(&node);
    if index.is_none() && !formation.platforms.is_empty() {
        r.reject(
            "formation.platforms",
            format!(
                "node {node} is in no platform's namespace; allowed: start it with -r __ns:=/PLATFORM, PLATFORM one of {}",
                formation.platforms.join(", ")
            ),
        );
    }
    let index = index?;
    Some((u16::try_from(index).ok()?, formation.platforms.get(index)?.clone()))
}

/// Key of the coordinator's parameter that makes every platform run the law in its own coordinator.
pub const LAW_ON_PLATFORMS: &str = "law.on_platforms";

impl ParameterTree {
    /// The platforms, as the coordinator sees them. Errors in them are reported when it reads its
    /// parameters.
    #[must_use]
    pub fn formation(&self) -> Formation {
        formation(&mut Reader::new(&self.for_node(COORDINATOR)))
    }

    /// Whether every platform has a coordinator of its own.
    #[must_use]
    pub fn law_on_platforms(&self) -> bool {
        self.for_node(COORDINATOR).get(LAW_ON_PLATFORMS).is_some_and(|entry| entry.value == Value::Bool(true))
    }

    /// Every node that these parameters define.
    #[must_use]
    pub fn node_set(&self) -> Vec<NodeInstance> {
        node_set(&self.formation().platforms, self.law_on_platforms())
    }

    /// Refuses sections that match none of these nodes; see [`Self::check_sections`].
    ///
    /// # Errors
    /// One for each such section.
    pub fn check_nodes(&self) -> Result<(), ParameterErrors> {
        let nodes = self.node_set();
        self.check_sections(nodes.iter().map(|instance| instance.name.as_str()))
    }

    /// The parameters of every node that these files define, after layering, as one ROS 2 parameter file.
    #[must_use]
    pub fn effective_yaml(&self) -> String {
        self.node_set().iter().map(|instance| self.for_node(&instance.name).to_yaml()).collect()
    }
}
