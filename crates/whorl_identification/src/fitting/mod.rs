//! Fits: models with parameters at their likeliest values.

pub(crate) mod low_pass;
pub(crate) mod refit;
pub(crate) mod tie;
pub(crate) mod ties;

use whorl_dynamics::effects::find;
use whorl_dynamics::{Effect, ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::case::Case;
use crate::fitting::refit::Fit;
use crate::fitting::ties::leave_open_what_is_tied;
use crate::selection::Selection;
use crate::{DiagnosisError, Options};

/// Refits the platform's own parameters together with `effects` (ids of the catalogue, may be empty) to the recordings, by the likelihood
/// of the readings ([`whorl_prediction::fit`]), as a diagnosis does: from the first values that the samples propose.
///
/// # Errors
/// As [`crate::diagnose`]; also for an unknown effect.
pub fn fit(
    training: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    effects: &[&str],
    options: &Options,
) -> Result<Fit, DiagnosisError> {
    let case = Case::new(training, &[], model, prior, options)?;
    // Effects that the model does not have yet.
    let mut chosen: Vec<&'static dyn Effect> = Vec::new();
    for id in effects {
        let effect = find(id).ok_or_else(|| DiagnosisError::UnknownEffect((*id).to_owned()))?;
        chosen.extend((!case.reference.model.effects.contains_key(*id)).then_some(effect));
    }
    let selection = Selection::begun(case.runs(), options)?;
    let Some(first) = chosen.first() else { return selection.base().fit(&case.reference) };
    let ids: Vec<&'static str> = chosen.iter().map(|effect| effect.info().id).collect();
    let beside = selection.beside_of(selection.base(), chosen.clone())?;
    let hypothesis = beside.and_then(|beside| beside.with(&ids));
    let nothing = || DiagnosisError::NoEffect(first.info().id.to_owned());
    let found = selection.runs.evaluate(hypothesis.ok_or_else(nothing)?, &[selection.base()])?;
    let mut fit = found.fit(&case.reference)?;
    let refit = found.refit(&case.reference);
    leave_open_what_is_tied(&mut fit, (&refit, &found.fitted), &case.training, &chosen, options.threads)?;
    Ok(fit)
}
