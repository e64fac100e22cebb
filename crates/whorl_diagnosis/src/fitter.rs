//! Models refitted jointly with effects that were chosen.

use std::cell::OnceCell;
use std::collections::BTreeMap;

use whorl_dynamics::effects::{catalogue, find};
use whorl_dynamics::{Effect, ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::evidence::problem::Problem;
use crate::parameters::Point;
use crate::parameters::available::Available;
use crate::refit::{Entered, Fit, Refit};
use crate::search::Search;
use crate::search::prospect::make_columns_for;
use crate::search::step::{base_point_with, point_of};
use crate::{DiagnosisError, Options, prepare};

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
    training: &'a [Recording],
    options: &'a Options,
    problem: Problem,
    /// The base model fitted along a smoothed motion, where first values of effects are looked for.
    smoothed: OnceCell<(Problem, Point)>,
    /// The platform's own parameters alone, in units, and the fit with them.
    base: OnceCell<(Vec<f64>, Fit)>,
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
        let (problem, _) = prepare(training, &[], model, prior, options, None, &mut |_| {})?;
        Ok(Self { training, options, problem, smoothed: OnceCell::new(), base: OnceCell::new() })
    }

    /// Refits the platform's own parameters together with `effects`, ids of the catalogue, by the likelihood of the readings
    /// ([`whorl_prediction::fit`]). Every fit begins anew: the order of calls does not matter.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn fit(&self, effects: &[&str]) -> Result<Fit, DiagnosisError> {
        let mut chosen = Vec::new();
        for id in effects {
            let effect = find(id).ok_or_else(|| DiagnosisError::UnknownEffect { id: (*id).to_owned() })?;
            if !self.problem.reference.model.effects.contains_key(*id) {
                chosen.push(effect);
            }
        }
        if chosen.is_empty() {
            return Ok(self.base()?.1.clone());
        }
        let base = &self.base()?.0;
        let (point, entered) = self.first_values(effects, &chosen)?;
        let mut refit = self.own_parameters();
        for effect in chosen {
            refit.add(effect, &point, entered.get(effect.info().id));
        }
        // The platform's own parameters begin where they are alone.
        let mut from = refit.units_of(&point);
        from.iter_mut().zip(base).for_each(|(from, base)| *from = *base);
        Ok(refit.fit(self.training, &from, self.options)?.1)
    }

    /// The platform's own parameters that its prior leaves open.
    fn own_parameters(&self) -> Refit<'_> {
        Refit::own(&self.problem.reference, &Available::of(&self.problem.runs))
    }

    fn base(&self) -> Result<&(Vec<f64>, Fit), DiagnosisError> {
        if let Some(base) = self.base.get() {
            return Ok(base);
        }
        let refit = self.own_parameters();
        let from = vec![0.0; refit.columns.len()];
        let (fitted, fit) = refit.fit(self.training, &from, self.options)?;
        Ok(self.base.get_or_init(|| (fitted.at, fit)))
    }

    /// Values of these effects along the smoothed motion, and how they entered.
    fn first_values(
        &self,
        ids: &[&str],
        chosen: &[&'static dyn Effect],
    ) -> Result<(Point, BTreeMap<&'static str, Entered>), DiagnosisError> {
        if self.smoothed.get().is_none() {
            let mut problem = self.problem.clone();
            let point = base_point_with(&mut problem, &mut None)?;
            let _ = self.smoothed.set((problem, point));
        }
        let Some((problem, point)) = self.smoothed.get() else { return Err(DiagnosisError::NoRecording) };
        // Columns of effects that take no part need not be made.
        let others = catalogue().iter().map(|effect| effect.info().id).filter(|id| !ids.contains(id));
        let options = Options { exclude: others.map(str::to_owned).collect(), ..self.options.clone() };
        let mut problem = problem.clone();
        let mut search = Search::at(&mut problem, None, &options, point.clone())?;
        make_columns_for(&mut search, ids)?;
        search.adopt(chosen)?;
        let found = point_of(search.problem, &search.layout, &search.point, &search.best);
        Ok((found, Entered::of(&search.layout, &search.best.members)))
    }
}
