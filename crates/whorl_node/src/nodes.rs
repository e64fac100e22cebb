//! The table of nodes: which nodes exist, and where they run.
//!
//! Launching, simulation, recording and the check of parameter files read it.

/// Where a node runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// On every platform's own computer, in the platform's namespace.
    Platform,
    /// Once for the formation, on any computer, without a namespace.
    Formation,
    /// Once for the formation; and on every platform as well where the law runs on the platforms.
    Either,
}

/// Row of a node in the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeInfo {
    /// Name of the node and of its program; the last part of its section in parameter files.
    pub name: &'static str,
    /// What it does, in a line.
    pub purpose: &'static str,
    /// Where it runs.
    pub place: Place,
    /// Whether it is a program. Otherwise it is part of another program and has only parameters of its own.
    pub is_program: bool,
    /// Whether it is given the simulated hardware's parameters (`params/truth/`).
    pub reads_truth: bool,
}

macro_rules! nodes {
    ($($node:ident $name:literal $place:ident $is_program:literal $reads_truth:literal $purpose:literal;)+) => {
        /// The nodes.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Node { $(#[doc = $purpose] $node),+ }

        impl Node {
            /// Every node.
            pub const ALL: &[Self] = &[$(Self::$node),+];

            /// Its row in the table.
            #[must_use]
            pub const fn info(self) -> NodeInfo {
                match self {
                    $(Self::$node => NodeInfo {
                        name: $name,
                        purpose: $purpose,
                        place: Place::$place,
                        is_program: $is_program,
                        reads_truth: $reads_truth,
                    }),+
                }
            }
        }
    };
}

nodes! {
//  node         name            place     program truth  purpose
    Driver       "driver"        Platform  true    true   "drives one platform: simulated hardware, a recording, real hardware";
    Estimator    "estimator"     Platform  true    false  "estimates attitude and gyro bias of one platform";
    LocalControl "local_control" Platform  true    false  "tracks the attitude reference of one platform with wheels and jets";
    ModelMonitor "model_monitor" Platform  true    false  "says whether one platform still moves as its model says";
    Coordinator  "coordinator"   Either    true    false  "commands the formation through an experiment";
    Recorder     "recorder"      Formation true    false  "records every topic into a run directory";
    Simulation   "simulation"    Formation false   false  "links and clocks of `whorl simulate`";
}

impl Node {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.info().name
    }

    /// The node of this name.
    #[must_use]
    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|node| node.name() == name)
    }

    /// The nodes of one platform.
    pub fn of_platform(law_on_platforms: bool) -> impl Iterator<Item = Self> {
        Self::ALL.iter().copied().filter(move |node| match node.info().place {
            Place::Platform => true,
            Place::Either => law_on_platforms,
            Place::Formation => false,
        })
    }

    /// The nodes that exist once.
    pub fn of_formation() -> impl Iterator<Item = Self> {
        Self::ALL.iter().copied().filter(|node| node.info().place != Place::Platform)
    }
}

/// One node of a node set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeInstance {
    /// Which node.
    pub node: Node,
    /// Index of its platform; `None` for a node of the formation.
    pub platform: Option<u16>,
    /// Fully qualified name: `/whorl_1/driver`, `/coordinator`.
    pub name: String,
}

/// Every node of a formation, in the order in which a simulation steps those that are due at the same time: each
/// platform's own, then those that run on platforms only where the law does, then the formation's.
#[must_use]
pub fn node_set<S: AsRef<str>>(platforms: &[S], law_on_platforms: bool) -> Vec<NodeInstance> {
    let on_platforms = |place: Place| {
        (0u16..).zip(platforms).flat_map(move |(index, platform)| {
            let own = Node::of_platform(law_on_platforms).filter(move |node| node.info().place == place);
            own.map(move |node| NodeInstance {
                node,
                platform: Some(index),
                name: format!("/{}/{}", platform.as_ref(), node.name()),
            })
        })
    };
    let of_formation = Node::of_formation().map(|node| NodeInstance {
        node,
        platform: None,
        name: format!("/{}", node.name()),
    });
    on_platforms(Place::Platform).chain(on_platforms(Place::Either)).chain(of_formation).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_set_has_a_coordinator_on_each_platform_where_the_law_runs_there() {
        let names = |law_on_platforms| -> Vec<String> {
            node_set(&["a", "b"], law_on_platforms).into_iter().map(|instance| instance.name).collect()
        };
        let own = [
            "/a/driver",
            "/a/estimator",
            "/a/local_control",
            "/a/model_monitor",
            "/b/driver",
            "/b/estimator",
            "/b/local_control",
            "/b/model_monitor",
        ];
        let formation = ["/coordinator", "/recorder", "/simulation"];
        assert_eq!(names(false), [&own[..], &formation].concat());
        assert_eq!(names(true), [&own[..], &["/a/coordinator", "/b/coordinator"], &formation].concat());
        assert_eq!(node_set(&["a", "b"], true)[5].platform, Some(1));
    }

    #[test]
    fn names_are_distinct_and_found() {
        for &node in Node::ALL {
            assert_eq!(Node::find(node.name()), Some(node));
        }
        assert_eq!(Node::find("driver2"), None);
    }

    #[test]
    fn every_program_has_its_folder_with_a_page() {
        let nodes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../nodes");
        let mut folders: Vec<String> = std::fs::read_dir(&nodes)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        // Where the programs themselves are.
        assert!(folders.iter().any(|folder| folder == "programs"));
        folders.retain(|folder| folder != "programs");
        folders.sort_unstable();
        let mut programs: Vec<&str> =
            Node::ALL.iter().filter(|node| node.info().is_program).map(|node| node.name()).collect();
        programs.sort_unstable();
        assert_eq!(folders, programs);
        for name in programs {
            assert!(nodes.join(name).join("README.md").is_file(), "{name} has no README.md");
        }
    }
}
