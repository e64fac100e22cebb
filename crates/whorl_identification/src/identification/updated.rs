//! The model that an identification leads to.

use thiserror::Error;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::Identification;

/// Why a result cannot be put into a model.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum UpdateError {
    /// A finding is fatal.
    #[error("the result must not be used: {0}")]
    Unusable(String),
    /// No platform has these values.
    #[error("no platform has the identified values: a mass or an inertia that no body has")]
    NoPlatform,
}

impl Identification {
    /// The model and its prior with the identified mass properties, with the constants of the actuators, and with the parameters of the
    /// effects that the model has: all together, since they were found together. Parameters that were not determined keep the
    /// prior's values. An effect that the model does not have is not added: adopting one is a decision of its own.
    ///
    /// # Errors
    /// [`UpdateError`].
    pub fn updated(&self) -> Result<(PlatformModel, ModelPrior), UpdateError> {
        if let Some(finding) = self.findings.iter().find(|finding| finding.fatal) {
            return Err(UpdateError::Unusable(finding.text.clone()));
        }
        self.updated.clone().ok_or(UpdateError::NoPlatform)
    }
}
