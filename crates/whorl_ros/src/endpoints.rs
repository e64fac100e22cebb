//! All readers and writers of one node: created together, renewed together.

use mio::event::Source;
use mio::{Interest, Registry, Token};
use whorl_msgs::{Route, Service};

use crate::error::RosError;
use crate::graph;
use crate::names::NodeName;
use crate::participant::{EndpointQos, Participant};
use crate::raw::{EndpointId, RawReader, RawWriter};
use crate::services::ServiceServer;

/// Endpoints that a node needs, with their names on the network.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub node: NodeName,
    pub subscriptions: Vec<(Route, String)>,
    pub publications: Vec<(Route, String)>,
    pub services: Vec<(Service, String)>,
    pub rosout: bool,
}

/// One of the parameter services.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ParameterService {
    Get,
    GetTypes,
    Set,
    SetAtomically,
    List,
    Describe,
}

impl ParameterService {
    pub(crate) const ALL: [Self; 6] =
        [Self::Get, Self::GetTypes, Self::Set, Self::SetAtomically, Self::List, Self::Describe];

    /// Name below the node's, and type in `rcl_interfaces/srv`.
    pub(crate) fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Get => ("get_parameters", "rcl_interfaces/srv/GetParameters"),
            Self::GetTypes => ("get_parameter_types", "rcl_interfaces/srv/GetParameterTypes"),
            Self::Set => ("set_parameters", "rcl_interfaces/srv/SetParameters"),
            Self::SetAtomically => {
                ("set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically")
            }
            Self::List => ("list_parameters", "rcl_interfaces/srv/ListParameters"),
            Self::Describe => ("describe_parameters", "rcl_interfaces/srv/DescribeParameters"),
        }
    }
}

/// Tokens below this one belong to the runner.
pub(crate) const FIRST_TOKEN: usize = 16;
const TOKENS_PER_GENERATION: usize = 1 << 16;

/// What an event on a token is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Readable {
    Subscription(usize),
    Service(usize),
    Parameter(usize),
}

/// The endpoints of one generation.
pub(crate) struct Endpoints {
    generation: usize,
    pub(crate) subscriptions: Vec<RawReader>,
    pub(crate) services: Vec<(Service, ServiceServer)>,
    pub(crate) parameters: Vec<(ParameterService, ServiceServer)>,
    writers: Vec<(Route, RawWriter)>,
    pub(crate) rosout: Option<RawWriter>,
    pub(crate) parameter_events: RawWriter,
    discovery_info: RawWriter,
}

impl Endpoints {
    pub(crate) fn new(participant: &Participant, plan: &Plan, generation: usize) -> Result<Self, RosError> {
        let topic = |route: &Route| {
            let info = route.topic.info();
            (info.message_type.name(), EndpointQos::from(info.qos))
        };
        let mut subscriptions = Vec::new();
        for (route, name) in &plan.subscriptions {
            let (message_type, qos) = topic(route);
            subscriptions.push(participant.reader(name, message_type, qos)?);
        }
        let mut writers = Vec::new();
        for (route, name) in &plan.publications {
            let (message_type, qos) = topic(route);
            writers.push((*route, participant.writer(name, message_type, qos)?));
        }
        let mut services = Vec::new();
        for (service, name) in &plan.services {
            services.push((*service, ServiceServer::new(participant, name, service.type_name())?));
        }
        let mut parameters = Vec::new();
        for service in ParameterService::ALL {
            let (name, service_type) = service.names();
            let name = format!("{}/{name}", plan.node.full());
            parameters.push((service, ServiceServer::new(participant, &name, service_type)?));
        }
        let rosout = plan
            .rosout
            .then(|| participant.writer("/rosout", "rcl_interfaces/msg/Log", EndpointQos::ROSOUT))
            .transpose()?;
        let parameter_events = participant.writer(
            "/parameter_events",
            "rcl_interfaces/msg/ParameterEvent",
            EndpointQos::PARAMETER_EVENTS,
        )?;
        let discovery_info = graph::writer(participant)?;
        Ok(Self {
            generation,
            subscriptions,
            services,
            parameters,
            writers,
            rosout,
            parameter_events,
            discovery_info,
        })
    }

    /// Watches everything readable.
    pub(crate) fn register(&mut self, registry: &Registry) -> Result<(), RosError> {
        let first = FIRST_TOKEN + self.generation * TOKENS_PER_GENERATION;
        for (index, reader) in self.readable().enumerate() {
            reader
                .register(registry, Token(first + index), Interest::READABLE)
                .map_err(RosError::io("watching a topic"))?;
        }
        Ok(())
    }

    /// Stops watching, before the endpoints are dropped.
    pub(crate) fn deregister(&mut self, registry: &Registry) {
        for reader in self.readable() {
            // A reader that cannot be taken off the poll is about to be closed anyway.
            let _ = reader.deregister(registry);
        }
    }

    fn readable(&mut self) -> impl Iterator<Item = &mut RawReader> {
        let services = self.services.iter_mut().map(|(_, server)| &mut server.requests);
        let parameters = self.parameters.iter_mut().map(|(_, server)| &mut server.requests);
        self.subscriptions.iter_mut().chain(services).chain(parameters)
    }

    /// What became readable, if it is one of ours.
    pub(crate) fn at(&self, token: Token) -> Option<Readable> {
        let first = FIRST_TOKEN + self.generation * TOKENS_PER_GENERATION;
        let index = token.0.checked_sub(first).filter(|index| *index < TOKENS_PER_GENERATION)?;
        let after_subscriptions = index.checked_sub(self.subscriptions.len());
        let Some(service) = after_subscriptions else { return Some(Readable::Subscription(index)) };
        match service.checked_sub(self.services.len()) {
            None => Some(Readable::Service(service)),
            Some(parameter) => (parameter < self.parameters.len()).then_some(Readable::Parameter(parameter)),
        }
    }

    pub(crate) fn writer(&self, route: Route) -> Option<&RawWriter> {
        // A node has at most some dozen writers.
        self.writers.iter().find(|(r, _)| *r == route).map(|(_, writer)| writer)
    }

    /// Servers of all services.
    pub(crate) fn servers(&self) -> impl Iterator<Item = &ServiceServer> {
        let services = self.services.iter().map(|(_, server)| server);
        services.chain(self.parameters.iter().map(|(_, server)| server))
    }

    /// Ids of everything that must find its peers again after a renewal, in the order of the plan.
    pub(crate) fn ids(&self) -> impl Iterator<Item = EndpointId> {
        let readers = self.subscriptions.iter().map(RawReader::id);
        readers.chain(self.writers.iter().map(|(_, writer)| writer.id()))
    }

    /// Reliable writers whose last messages must be acknowledged.
    pub(crate) fn reliable_writers(&self) -> impl Iterator<Item = &RawWriter> {
        let services = self.services.iter().map(|(_, server)| &server.responses);
        let parameters = self.parameters.iter().map(|(_, server)| &server.responses);
        let topics = self.writers.iter().filter(|(route, _)| route.topic.info().qos.reliable);
        services.chain(parameters).chain(topics.map(|(_, writer)| writer)).chain(self.rosout.as_ref())
    }

    /// Publishes which endpoints belong to the node, or (`alive` false) that it is gone.
    pub(crate) fn announce(
        &self,
        participant: &Participant,
        node: &NodeName,
        alive: bool,
    ) -> Result<(), RosError> {
        let servers = || self.servers();
        let readers = self.subscriptions.iter().map(RawReader::id);
        let readers = readers.chain(servers().map(|server| server.requests.id()));
        let writers = self.writers.iter().map(|(_, writer)| writer.id());
        let writers = writers
            .chain(servers().map(|server| server.responses.id()))
            .chain(self.rosout.as_ref().map(RawWriter::id))
            .chain([self.parameter_events.id()]);
        graph::announce(&self.discovery_info, participant.id(), alive.then_some(node), readers, writers)
    }
}
