//! The model that an identification leads to.

use thiserror::Error;
use whorl_dynamics::mass_properties::MassPropertiesError;
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::{EffectParameter, Identification};
use crate::mass_parameters::mass_properties;

/// Why a result cannot be put into a model.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum UpdateError {
    /// A finding is fatal.
    #[error("the result must not be used: {0}")]
    Unusable(String),
    /// No rigid body has these mass properties.
    #[error(transparent)]
    MassProperties(#[from] MassPropertiesError),
}

impl Identification {
    /// The model and its prior with the identified mass properties, and with the parameters of the effects that the model
    /// has. Parameters that were not determined keep the prior's values. An effect that the model does not have is not
    /// added: adopting one is a decision of its own.
    ///
    /// # Errors
    /// [`UpdateError`].
    pub fn updated(
        &self,
        model: &PlatformModel,
        prior: &ModelPrior,
    ) -> Result<(PlatformModel, ModelPrior), UpdateError> {
        if let Some(finding) = self.findings.iter().find(|finding| finding.fatal) {
            return Err(UpdateError::Unusable(finding.text.clone()));
        }
        let (mut model, mut prior) = (model.clone(), prior.clone());
        model.mass_properties = mass_properties(&self.estimate, model.mass_properties.mass_kg())?;
        let stddev = self.stddev();
        for (n, (i, j)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].into_iter().enumerate() {
            prior.inertia_b_kg_m2[(i, j)] = stddev[n];
            prior.inertia_b_kg_m2[(j, i)] = stddev[n];
        }
        prior.gravity_offset_b_n_m.copy_from(&stddev.fixed_rows::<3>(6));
        for EffectParameter { effect, name, value, stddev, .. } in &self.effects {
            if let Some(parameters) = model.effects.get_mut(*effect) {
                parameters.insert(name.clone(), *value);
                prior.effects.entry((*effect).to_owned()).or_default().insert(name.clone(), *stddev);
            }
        }
        Ok((model, prior))
    }
}
