//! The whole node set from one parameter tree.

use std::fmt::Display;
use std::time::Duration;

use thiserror::Error;
use whorl_coordinator::CoordinatorCore;
use whorl_driver::{Backend, DriverCore, DriverError};
use whorl_estimator::EstimatorCore;
use whorl_local_control::LocalControlCore;
use whorl_model_monitor::ModelMonitorCore;
use whorl_msgs::topics::PlatformId;
use whorl_node::{Node, NodeCore, NodeInstance, Timestamp};
use whorl_params::{
    Formation, NodeParameters, ParameterError, ParameterErrors, ParameterTree, Reader, Span, Value,
    effective_yaml, formation, non_negative, range, try_read,
};

use crate::bus::Bus;
use crate::link::{Cut, Host, LinkParameters};

/// Why a node set cannot be built.
#[derive(Debug, Error)]
pub enum NodeSetError {
    /// Parameters are wrong.
    #[error(transparent)]
    Parameters(#[from] ParameterErrors),
    /// A driver cannot start.
    #[error("{node}: {source}")]
    Driver {
        /// The node.
        node: String,
        /// Why.
        source: DriverError,
    },
    /// Another node cannot start.
    #[error("{node}: {reason}")]
    Node {
        /// The node.
        node: String,
        /// Why.
        reason: String,
    },
    /// Replay and hardware happen in real time.
    #[error("{node}: only backend sim runs in a simulation; start the node set for replay or hardware")]
    Backend {
        /// The node.
        node: String,
    },
}

/// A node set, ready to run.
pub struct NodeSet {
    /// The bus with all nodes on it.
    pub bus: Bus,
    /// Names of the platforms.
    pub platforms: Vec<String>,
    /// The parameters in force of every node, as a ROS 2 parameter file.
    pub effective_parameters: String,
}

/// Parameters of the simulation itself (node name `simulation`).
#[derive(Debug, Clone, PartialEq)]
struct SimulationParameters {
    local_delay: Duration,
    link: LinkParameters,
    /// Computers whose clocks have an offset, and the offsets \[s\].
    clocks: Vec<(PlatformId, f64)>,
}

/// Asks for every parameter of the simulation itself: for lists of parameters.
pub fn ask_simulation(r: &mut Reader<'_>) {
    read_simulation(r);
}

fn read_simulation(r: &mut Reader<'_>) -> Option<SimulationParameters> {
    let platforms = formation(r).platforms;
    let local_delay_s = r.f64_or(
        "local_delay_s",
        2e-4,
        range(0.0..=1.0),
        "delay of messages between nodes of one computer [s]; measured over DDS on loopback: 0.1 to 0.3 ms",
    );
    let link = r.group("link", |r| LinkParameters {
        delay_s: r.f64_or("delay_s", 1e-3, range(0.0..=10.0), "delay between computers [s]"),
        jitter_s: r.f64_or("jitter_s", 0.0, range(0.0..=10.0), "further delay, uniform from 0 to this [s]"),
        loss: r.f64_or("loss", 0.0, range(0.0..=1.0), "share of messages lost between computers"),
        cuts: r
            .children("cuts")
            .iter()
            .map(|name| {
                r.group("cuts", |r| {
                    r.group(name, |r| Cut {
                        span: Span {
                            start_s: r.f64(
                                "start_s",
                                non_negative(),
                                "when the link is cut, from the start [s]",
                            ),
                            length_s: r.f64("length_s", non_negative(), "for how long [s]"),
                        },
                        platform: read_cut_platform(r, &platforms),
                    })
                })
            })
            .collect(),
    });
    let mut clocks = Vec::new();
    for name in r.children("clock_offset_s") {
        let offset_s = r.group("clock_offset_s", |r| {
            r.f64(
                &name,
                range(-3600.0..=3600.0),
                "the clock of that platform's computer less the ground's [s]",
            )
        });
        match platforms.iter().position(|platform| *platform == name).map(u16::try_from) {
            Some(Ok(index)) => clocks.push((PlatformId(index), offset_s)),
            _ => {
                let allowed = platforms.join(", ");
                r.reject(
                    &format!("clock_offset_s.{name}"),
                    format!("`{name}` is no platform; allowed: {allowed}"),
                );
            }
        }
    }
    Some(SimulationParameters { local_delay: Duration::from_secs_f64(local_delay_s), link, clocks })
}

fn read_cut_platform(r: &mut Reader<'_>, platforms: &[String]) -> Option<PlatformId> {
    let name =
        r.optional_string("platform", "the platform that is cut off alone; left out: every link is cut")?;
    let found = platforms.iter().position(|platform| *platform == name);
    if found.is_none() {
        r.reject("platform", format!("`{name}` is no platform; allowed: {}", platforms.join(", ")));
    }
    found.and_then(|index| u16::try_from(index).ok()).map(PlatformId)
}

/// Collects the parameters in force of each node.
struct Builder<'a> {
    tree: &'a ParameterTree,
    effective: String,
    errors: Vec<ParameterError>,
}

impl Builder<'_> {
    /// Reads one node's parameters; `None` when they are wrong, with the reasons kept.
    fn read<T>(&mut self, node: &str, read: impl FnOnce(&mut Reader<'_>) -> Option<T>) -> Option<T> {
        self.read_from(&self.tree.for_node(node), read)
    }

    fn read_from<T>(
        &mut self,
        own: &NodeParameters,
        read: impl FnOnce(&mut Reader<'_>) -> Option<T>,
    ) -> Option<T> {
        match try_read(own, read) {
            Ok((values, descriptors)) => {
                self.effective.push_str(&effective_yaml([(own.node(), descriptors.as_slice())]));
                Some(values)
            }
            Err(errors) => {
                self.errors.extend(errors.iter().cloned());
                None
            }
        }
    }
}

/// Makes the core of a node whose parameters have been read.
type Start = Box<dyn FnOnce() -> Result<Box<dyn NodeCore>, NodeSetError>>;

impl NodeSet {
    /// Builds every node of the table that runs in a simulation. `seed` takes the place of every driver's seed and
    /// drives the link.
    ///
    /// # Errors
    /// All errors in the parameters of any node; or why a node cannot start.
    pub fn build(tree: &ParameterTree, seed: u64, start: Timestamp) -> Result<Self, NodeSetError> {
        let mut builder = Builder { tree, effective: String::new(), errors: Vec::new() };
        let Formation { platforms } = tree.formation();
        let seed_value = Value::Integer(i64::try_from(seed).unwrap_or(i64::MAX));
        let mut simulation = None;
        let mut starts: Vec<(String, Host, Start)> = Vec::new();
        for NodeInstance { node, platform, name } in tree.node_set() {
            let host = platform.map_or(Host::Ground, |index| Host::Platform(PlatformId(index)));
            let core = match node {
                Node::Driver => {
                    let own = tree.for_node(&name).with("seed", seed_value.clone());
                    let read = builder.read_from(&own, whorl_driver::parameters::read);
                    read.map(|parameters| start_driver(name.clone(), parameters))
                }
                Node::Estimator => {
                    let read = builder.read(&name, whorl_estimator::parameters::read);
                    read.map(|parameters| start_node(&name, move || EstimatorCore::new(parameters)))
                }
                Node::LocalControl => {
                    let read = builder.read(&name, whorl_local_control::parameters::read);
                    read.map(|parameters| start_node(&name, move || LocalControlCore::new(parameters)))
                }
                Node::ModelMonitor => {
                    let read = builder.read(&name, whorl_model_monitor::parameters::read);
                    read.map(|parameters| start_node(&name, move || ModelMonitorCore::new(parameters)))
                }
                Node::Coordinator => {
                    let read = builder.read(&name, whorl_coordinator::parameters::read);
                    read.map(|parameters| start_node(&name, move || CoordinatorCore::new(parameters)))
                }
                Node::Simulation => {
                    simulation = builder.read(&name, read_simulation);
                    None
                }
                // The caller observes, and may record, all messages on the bus.
                Node::Recorder => None,
            };
            starts.extend(core.map(|core| (name, host, core)));
        }
        // A node that lacks what stands under a mistyped name is the smaller news; without platforms, no name is known.
        if !platforms.is_empty() {
            tree.check_nodes()?;
        }
        ParameterErrors::check(std::mem::take(&mut builder.errors))?;
        tree.check_nodes()?;
        // Present, since there were no errors.
        let Some(simulation) = simulation else {
            return Err(failed("/simulation", "incomplete parameters"));
        };
        let mut bus = Bus::new(start, platforms.len(), simulation.local_delay, simulation.link, seed);
        for (name, host, start) in starts {
            bus.add(name, host, start()?, Duration::ZERO);
        }
        for (platform, offset_s) in simulation.clocks {
            bus.set_clock(Host::Platform(platform), offset_s);
        }
        Ok(Self { bus, platforms, effective_parameters: builder.effective })
    }
}

fn start_driver(node: String, parameters: whorl_driver::Parameters) -> Start {
    Box::new(move || {
        if !matches!(parameters.backend, Backend::Simulated { .. }) {
            return Err(NodeSetError::Backend { node });
        }
        match DriverCore::from_parameters(&parameters, Vec::new(), None) {
            Ok(core) => Ok(Box::new(core)),
            Err(source) => Err(NodeSetError::Driver { node, source }),
        }
    })
}

fn start_node<C: NodeCore + 'static, E: Display>(
    node: &str,
    core: impl FnOnce() -> Result<C, E> + 'static,
) -> Start {
    let node = node.to_owned();
    Box::new(move || match core() {
        Ok(core) => Ok(Box::new(core)),
        Err(error) => Err(failed(&node, error)),
    })
}

fn failed(node: &str, reason: impl Display) -> NodeSetError {
    NodeSetError::Node { node: node.to_owned(), reason: reason.to_string() }
}
