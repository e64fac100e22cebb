//! Models refitted jointly with effects that were chosen.

use std::cell::OnceCell;

use whorl_dynamics::effects::find;
use whorl_dynamics::{Effect, ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::case::Case;
use crate::fitting::refit::Fit;
use crate::fitting::ties::leave_open;
use crate::selection::{Beside, Selection, Told};
use crate::{DiagnosisError, Options};

/// Refits the platform's own parameters together with `effects` (ids of the catalogue, empty to refit the
/// base only) to the recordings.
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
    Fitter::new(training, model, prior, options)?.fit(effects)
}

/// Recordings and a model, to be refitted with one set of effects after the other.
pub struct Fitter<'a> {
    case: Case<'a>,
    options: &'a Options,
    /// The platform's own parameters alone.
    base: OnceCell<Fit>,
}

impl<'a> Fitter<'a> {
    /// Checks the recordings against the model.
    ///
    /// # Errors
    /// As [`crate::diagnose`].
    pub fn new(
        training: &'a [Recording],
        model: &PlatformModel,
        prior: &ModelPrior,
        options: &'a Options,
    ) -> Result<Self, DiagnosisError> {
        Ok(Self { case: Case::new(training, &[], model, prior, options)?, options, base: OnceCell::new() })
    }

    /// Refits the platform's own parameters together with `effects`, ids of the catalogue, by the likelihood of the readings
    /// ([`whorl_prediction::fit`]), as a diagnosis does: from the first values that the samples propose. Every fit begins anew: the order of
    /// calls does not matter.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn fit(&self, effects: &[&str]) -> Result<Fit, DiagnosisError> {
        let chosen = self.chosen(effects)?;
        if let Some(base) = self.base.get().filter(|_| chosen.is_empty()) {
            return Ok(base.clone());
        }
        let runs = self.case.runs();
        let selection = Selection::begun(runs, self.options)?;
        let base = selection.base();
        if chosen.is_empty() {
            let fit = base.fit(&self.case.reference)?;
            return Ok(self.base.get_or_init(|| fit).clone());
        }
        let told = Told::of(&selection.observed, &selection.lines, self.case.available.sample_s);
        let ids: Vec<&'static str> = chosen.iter().map(|effect| effect.info().id).collect();
        let is_asked = |effect: &dyn Effect| ids.contains(&effect.info().id);
        let beside = Beside::new(&runs, base, &told.clues(), is_asked, None)?;
        let nothing =
            || DiagnosisError::NoEffect { id: ids.first().map_or_else(String::new, |id| (*id).to_owned()) };
        let hypothesis = beside.and_then(|beside| beside.with(&ids)).ok_or_else(nothing)?;
        let found = runs.evaluate(hypothesis, &[base])?;
        let mut fit = found.fit(&self.case.reference)?;
        let refit = found.refit(&self.case.reference);
        fit.ties = refit.ties(&self.case.training, &found.fitted, &chosen, self.options)?;
        leave_open(&fit.ties, &mut fit.model, &mut fit.prior);
        Ok(fit)
    }

    /// Effects of these ids that the model does not have yet.
    fn chosen(&self, effects: &[&str]) -> Result<Vec<&'static dyn Effect>, DiagnosisError> {
        let mut chosen = Vec::new();
        for id in effects {
            let effect = find(id).ok_or_else(|| DiagnosisError::UnknownEffect { id: (*id).to_owned() })?;
            if !self.case.reference.model.effects.contains_key(*id) {
                chosen.push(effect);
            }
        }
        Ok(chosen)
    }
}
