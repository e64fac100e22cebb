//! Reads and sets the parameters of another node.

use std::time::Duration;

use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces as rcl;
use thiserror::Error;
use whorl_params::Value;

use crate::endpoints::ParameterService;
use crate::error::RosError;
use crate::parameter_wire::{from_wire, to_wire};
use crate::participant::Participant;
use crate::services::ServiceClient;

/// What can go wrong with the parameters of another node.
#[derive(Debug, Error)]
pub enum ParameterClientError {
    /// The node refused the change.
    #[error("{name} is refused: {reason}")]
    Refused {
        /// The parameter.
        name: String,
        /// The node's reason.
        reason: String,
    },
    /// The answer does not belong to the question.
    #[error("the answer does not fit the question")]
    Answer,
    /// The node did not answer, or DDS failed.
    #[error(transparent)]
    Ros(#[from] RosError),
}

/// A node's description of one of its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterDescription {
    /// Full key.
    pub name: String,
    /// What it means.
    pub description: String,
    /// What is allowed, in words.
    pub constraints: String,
    /// Smallest and largest value, for numbers.
    pub range: Option<(f64, f64)>,
    /// Whether it is fixed when the node starts.
    pub read_only: bool,
}

/// A client of a node's parameter services.
pub struct ParameterClient {
    get: ServiceClient,
    set: ServiceClient,
    list: ServiceClient,
    describe: ServiceClient,
}

impl ParameterClient {
    /// A client for the node with this full name, e.g. `/whorl_1/estimator`.
    ///
    /// # Errors
    /// When DDS refuses.
    pub fn new(participant: &Participant, node: &str) -> Result<Self, RosError> {
        let client = |service: ParameterService| {
            let (name, service_type) = service.names();
            ServiceClient::new(participant, &format!("{node}/{name}"), service_type)
        };
        Ok(Self {
            get: client(ParameterService::Get)?,
            set: client(ParameterService::SetAtomically)?,
            list: client(ParameterService::List)?,
            describe: client(ParameterService::Describe)?,
        })
    }

    /// Names of all parameters.
    ///
    /// # Errors
    /// When the node does not answer within `timeout`.
    pub fn list(
        &self,
        participant: &Participant,
        timeout: Duration,
    ) -> Result<Vec<String>, ParameterClientError> {
        let request = rcl::ListParametersRequest { prefixes: Vec::new(), depth: 0 };
        let answer: rcl::ListParametersResponse = self.list.call(participant, &request, timeout)?;
        Ok(answer.result.names)
    }

    /// Values, `None` for a parameter that is not set or not known.
    ///
    /// # Errors
    /// When the node does not answer within `timeout`.
    pub fn get(
        &self,
        participant: &Participant,
        names: &[&str],
        timeout: Duration,
    ) -> Result<Vec<Option<Value>>, ParameterClientError> {
        let names = names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let request = rcl::GetParametersRequest { names };
        let answer: rcl::GetParametersResponse = self.get.call(participant, &request, timeout)?;
        if answer.values.len() != request.names.len() {
            return Err(ParameterClientError::Answer);
        }
        Ok(answer.values.iter().map(|value| from_wire(value).ok()).collect())
    }

    /// Sets one parameter.
    ///
    /// # Errors
    /// The node's reason, or when it does not answer within `timeout`.
    pub fn set(
        &self,
        participant: &Participant,
        name: &str,
        value: &Value,
        timeout: Duration,
    ) -> Result<(), ParameterClientError> {
        let parameter = raw::Parameter { name: name.to_owned(), value: to_wire(Some(value)) };
        let request = rcl::SetParametersRequest { parameter: vec![parameter] };
        let answer: rcl::SetParametersAtomicallyResponse = self.set.call(participant, &request, timeout)?;
        match answer.result {
            raw::SetParametersResult { successful: true, .. } => Ok(()),
            raw::SetParametersResult { reason, .. } => {
                Err(ParameterClientError::Refused { name: name.to_owned(), reason })
            }
        }
    }

    /// Descriptions of some of the node's parameters.
    ///
    /// # Errors
    /// When the node does not answer within `timeout`.
    pub fn describe(
        &self,
        participant: &Participant,
        names: &[&str],
        timeout: Duration,
    ) -> Result<Vec<ParameterDescription>, ParameterClientError> {
        let names = names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let request = rcl::DescribeParametersRequest { names };
        let answer: rcl::DescribeParametersResponse = self.describe.call(participant, &request, timeout)?;
        #[expect(clippy::cast_precision_loss, reason = "the ends of an integer range, for people")]
        let range = |d: &raw::ParameterDescriptor| {
            let double = d.floating_point_range.first().map(|r| (r.from_value, r.to_value));
            double.or(d.integer_range.first().map(|r| (r.from_value as f64, r.to_value as f64)))
        };
        Ok(answer
            .values
            .into_iter()
            .map(|d| ParameterDescription {
                range: range(&d),
                name: d.name,
                description: d.description,
                constraints: d.additional_constraints,
                read_only: d.read_only,
            })
            .collect())
    }
}
