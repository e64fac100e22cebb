//! The whole node set from one parameter tree.

use std::time::Duration;

use thiserror::Error;
use whorl_coordinator::CoordinatorCore;
use whorl_coordinator::parameters::Role;
use whorl_driver::{Backend, DriverCore, DriverError};
use whorl_estimator::EstimatorCore;
use whorl_local_control::LocalControlCore;
use whorl_msgs::topics::PlatformId;
use whorl_node::Timestamp;
use whorl_params::{
    Formation, NodeParameters, ParameterError, ParameterErrors, ParameterTree, Reader, Value, effective_yaml,
    formation, non_negative, range, try_read,
};

use crate::bus::{Bus, Host};
use crate::link::{Cut, LinkParameters};

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
    /// Computers whose clocks are off, and by how much \[s\].
    clocks: Vec<(PlatformId, f64)>,
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
                        start_s: r.f64("start_s", non_negative(), "when the link is cut, from the start [s]"),
                        length_s: r.f64("length_s", non_negative(), "for how long [s]"),
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

/// Collects what each node's parameters came to.
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

impl NodeSet {
    /// Builds driver, estimator and local control of every platform and the coordinator. `seed`
    /// takes the place of every driver's seed and drives the link.
    ///
    /// # Errors
    /// Everything that is wrong with the parameters of any node; or why a node cannot start.
    pub fn build(tree: &ParameterTree, seed: u64, start: Timestamp) -> Result<Self, NodeSetError> {
        let mut builder = Builder { tree, effective: String::new(), errors: Vec::new() };
        let coordinator = builder.read("/coordinator", whorl_coordinator::parameters::read);
        let on_platforms = coordinator.as_ref().is_some_and(|c| c.role == Role::Observer);
        let simulation = builder.read("/simulation", read_simulation);
        let Formation { platforms } = formation(&mut Reader::new(&tree.for_node("/coordinator")));
        let seed_value = Value::Integer(i64::try_from(seed).unwrap_or(i64::MAX));
        let mut sets = Vec::new();
        let mut own_coordinators = Vec::new();
        for platform in &platforms {
            let own = tree.for_node(&format!("/{platform}/driver")).with("seed", seed_value.clone());
            let driver = builder.read_from(&own, whorl_driver::parameters::read);
            let estimator =
                builder.read(&format!("/{platform}/estimator"), whorl_estimator::parameters::read);
            let control =
                builder.read(&format!("/{platform}/local_control"), whorl_local_control::parameters::read);
            if on_platforms {
                let own =
                    builder.read(&format!("/{platform}/coordinator"), whorl_coordinator::parameters::read);
                own_coordinators.extend(own);
            }
            sets.extend(driver.zip(estimator).zip(control));
        }
        ParameterErrors::check(std::mem::take(&mut builder.errors))?;
        let names = whorl_params::node_names(&Formation { platforms: platforms.clone() });
        tree.check_sections(names.iter().map(String::as_str))?;
        // Without errors both were read.
        let (Some(coordinator), Some(simulation)) = (coordinator, simulation) else {
            return Err(NodeSetError::Node {
                node: "/coordinator".into(),
                reason: "incomplete parameters".into(),
            });
        };
        let mut bus = Bus::new(start, platforms.len(), simulation.local_delay, simulation.link, seed);
        for (index, ((driver, estimator), control)) in (0u16..).zip(sets) {
            let host = Host::Platform(PlatformId(index));
            let name = driver.name.clone();
            let node = |kind: &str| format!("/{name}/{kind}");
            if !matches!(driver.backend, Backend::Simulated { .. }) {
                return Err(NodeSetError::Backend { node: node("driver") });
            }
            let core = DriverCore::from_parameters(&driver, Vec::new(), |_| false)
                .map_err(|source| NodeSetError::Driver { node: node("driver"), source })?;
            bus.add(node("driver"), host, Box::new(core), Duration::ZERO);
            let core = EstimatorCore::new(estimator).map_err(|e| failed(node("estimator"), e))?;
            bus.add(node("estimator"), host, Box::new(core), Duration::ZERO);
            let core = LocalControlCore::new(control).map_err(|e| failed(node("local_control"), e))?;
            bus.add(node("local_control"), host, Box::new(core), Duration::ZERO);
        }
        for (index, own) in (0u16..).zip(own_coordinators) {
            let Some(platform) = platforms.get(usize::from(index)) else { break };
            let name = format!("/{platform}/coordinator");
            let core = CoordinatorCore::new(own).map_err(|e| failed(name.clone(), e))?;
            bus.add(name, Host::Platform(PlatformId(index)), Box::new(core), Duration::ZERO);
        }
        let core = CoordinatorCore::new(coordinator).map_err(|e| failed("/coordinator".into(), e))?;
        bus.add("/coordinator", Host::Ground, Box::new(core), Duration::ZERO);
        for (platform, offset_s) in simulation.clocks {
            bus.set_clock(Host::Platform(platform), offset_s);
        }
        Ok(Self { bus, platforms, effective_parameters: builder.effective })
    }
}

fn failed(node: String, reason: impl std::fmt::Display) -> NodeSetError {
    NodeSetError::Node { node, reason: reason.to_string() }
}
