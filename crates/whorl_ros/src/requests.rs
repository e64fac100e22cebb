//! Requests to a node: its services and its parameters.

use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces as rcl;
use serde::{Serialize, de::DeserializeOwned};
use whorl_msgs::cdr;
use whorl_msgs::topics::ExperimentResponse;
use whorl_node::{Configurable, Event, LogLevel, Response};
use whorl_params::NodeParameters;

use crate::connection::Connection;
use crate::endpoints::ParameterService;
use crate::error::RosError;
use crate::parameters;
use crate::services::{RequestId, ServiceServer, TextRequest};
use crate::shell::Shell;

impl<C: Configurable> Shell<C> {
    pub(crate) fn serve(&mut self, connection: &Connection, generation: usize, index: usize) {
        let Some(endpoints) = connection.generations().nth(generation) else { return };
        let Some((service, server)) = endpoints.services.get(index) else { return };
        while let Some((id, bytes)) = self.take_request(connection, server) {
            let answer = match cdr::decode::<TextRequest>("service request", &bytes) {
                Ok(request) => {
                    let event = Event::Request { service: *service, argument: &request.argument };
                    match self.step(connection, event) {
                        Some(Response { success, message }) => ExperimentResponse { success, message },
                        None => {
                            ExperimentResponse { success: false, message: "the node did not answer".into() }
                        }
                    }
                }
                Err(error) => ExperimentResponse { success: false, message: error.to_string() },
            };
            self.answer(connection, server, id, &answer);
        }
    }

    fn take_request(
        &mut self,
        connection: &Connection,
        server: &ServiceServer,
    ) -> Option<(RequestId, Vec<u8>)> {
        loop {
            match server.take() {
                Ok(request) => return request,
                Err(error) => self.say(connection, LogLevel::Warn, format!("a request is dropped: {error}")),
            }
        }
    }

    fn answer<T: Serialize>(
        &mut self,
        connection: &Connection,
        server: &ServiceServer,
        id: RequestId,
        answer: &T,
    ) {
        if let Err(error) = server.respond(id, answer) {
            self.say(connection, LogLevel::Warn, format!("a request could not be answered: {error}"));
        }
    }

    pub(crate) fn serve_parameters(&mut self, connection: &Connection, generation: usize, index: usize) {
        let Some(endpoints) = connection.generations().nth(generation) else { return };
        let Some((service, server)) = endpoints.parameters.get(index) else { return };
        while let Some((id, bytes)) = self.take_request(connection, server) {
            if let Err(error) = self.serve_parameter(connection, *service, server, id, &bytes) {
                self.say(connection, LogLevel::Warn, format!("{}: {error}", service.names().0));
            }
        }
    }

    fn serve_parameter(
        &mut self,
        connection: &Connection,
        service: ParameterService,
        server: &ServiceServer,
        id: RequestId,
        bytes: &[u8],
    ) -> Result<(), RosError> {
        fn request<T: DeserializeOwned>(service: ParameterService, bytes: &[u8]) -> Result<T, RosError> {
            Ok(cdr::decode(service.names().1, bytes)?)
        }
        let result = |outcome: Result<(), String>| match outcome {
            Ok(()) => raw::SetParametersResult { successful: true, reason: String::new() },
            Err(reason) => raw::SetParametersResult { successful: false, reason },
        };
        match service {
            ParameterService::Get => {
                let rcl::GetParametersRequest { names } = request(service, bytes)?;
                server.respond(id, &rcl::GetParametersResponse { values: self.parameters.get(&names) })
            }
            ParameterService::GetTypes => {
                let rcl::GetParameterTypesRequest { names } = request(service, bytes)?;
                server.respond(id, &rcl::GetParameterTypesResponse { values: self.parameters.types(&names) })
            }
            ParameterService::List => {
                let rcl::ListParametersRequest { prefixes, depth } = request(service, bytes)?;
                let result = self.parameters.list(&prefixes, depth);
                server.respond(id, &rcl::ListParametersResponse { result })
            }
            ParameterService::Describe => {
                let rcl::DescribeParametersRequest { names } = request(service, bytes)?;
                let values = self.parameters.descriptions(&names);
                server.respond(id, &rcl::DescribeParametersResponse { values })
            }
            ParameterService::Set => {
                let rcl::SetParametersRequest { parameter } = request(service, bytes)?;
                let results = parameter
                    .iter()
                    .map(|change| result(self.set(connection, std::slice::from_ref(change))))
                    .collect();
                server.respond(id, &rcl::SetParametersResponse { results })
            }
            ParameterService::SetAtomically => {
                let rcl::SetParametersRequest { parameter } = request(service, bytes)?;
                let result = result(self.set(connection, &parameter));
                server.respond(id, &rcl::SetParametersAtomicallyResponse { result })
            }
        }
    }

    fn set(&mut self, connection: &Connection, changes: &[raw::Parameter]) -> Result<(), String> {
        let Self { core, read, parameters, .. } = self;
        let read = &*read;
        let mut apply = |all: &NodeParameters| {
            let (values, descriptors) = parameters::read(all, read).map_err(|e| e.to_string())?;
            core.reconfigure(&values)?;
            Ok(descriptors)
        };
        let names = || changes.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        match parameters.set(changes, &mut apply) {
            Ok(changed) => {
                if !changed.is_empty() {
                    self.say(connection, LogLevel::Info, format!("parameter set: {}", names()));
                    self.publish_parameter_event(connection, changed);
                }
                Ok(())
            }
            Err(reason) => {
                self.say(connection, LogLevel::Warn, format!("parameter set refused: {reason}"));
                Err(reason)
            }
        }
    }

    fn publish_parameter_event(&mut self, connection: &Connection, changed: Vec<raw::Parameter>) {
        let event = parameters::ParameterEvent {
            stamp: self.clock.now().into(),
            node: self.name.full(),
            new_parameters: Vec::new(),
            changed_parameters: changed,
            deleted_parameters: Vec::new(),
        };
        let writer = &connection.endpoints().parameter_events;
        let sent = cdr::encode("rcl_interfaces/msg/ParameterEvent", &event).map_err(RosError::from);
        if sent.and_then(|bytes| writer.publish(&bytes)).is_err() {
            self.statistics.publish_failures += 1;
        }
    }
}
