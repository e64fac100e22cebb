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
use crate::search::expected_information::make_columns_for;
use crate::search::step::{base_point_with, point_of};
use crate::ties::leave_open;
use crate::{DiagnosisError, Options, delaying, prepare};

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
        let model = options.delaying.as_ref().unwrap_or(model);
        let (mut problem, _) = prepare(training, &[], model, prior, options, None, &mut |_| {})?;
        let delaying = delaying(&problem, training, options)?;
        if delaying != *model {
            problem = prepare(training, &[], &delaying, prior, options, None, &mut |_| {})?.0;
        }
        Ok(Self { training, options, problem, smoothed: OnceCell::new(), base: OnceCell::new() })
    }

    /// Refits the platform's own parameters together with `effects`, ids of the catalogue, by the likelihood of the readings
    /// ([`whorl_prediction::fit`]). Every fit begins anew: the order of calls does not matter.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn fit(&self, effects: &[&str]) -> Result<Fit, DiagnosisError> {
        let chosen = self.chosen(effects)?;
        let base = self.base()?;
        if chosen.is_empty() {
            return Ok(base.1.clone());
        }
        let (refit, found) = self.with_first_values(effects, &chosen)?;
        // The platform's own parameters are where they are alone, without the effects and with them; or where they are with them.
        let with_base = |mut units: Vec<f64>| {
            units.iter_mut().zip(&base.0).for_each(|(from, base)| *from = *base);
            units
        };
        let starts = [with_base(vec![0.0; found.len()]), with_base(found.clone()), found];
        let (fitted, mut fit) = refit.fit(self.training, &starts, self.options)?;
        fit.ties = refit.ties(self.training, &fitted, &chosen, self.options)?;
        leave_open(&fit.ties, &mut fit.model, &mut fit.prior);
        Ok(fit)
    }

    /// Effects of these ids that the model does not have yet.
    fn chosen(&self, effects: &[&str]) -> Result<Vec<&'static dyn Effect>, DiagnosisError> {
        let mut chosen = Vec::new();
        for id in effects {
            let effect = find(id).ok_or_else(|| DiagnosisError::UnknownEffect { id: (*id).to_owned() })?;
            if !self.problem.reference.model.effects.contains_key(*id) {
                chosen.push(effect);
            }
        }
        Ok(chosen)
    }

    /// What a fit with these effects changes, and values along the smoothed motion.
    fn with_first_values(
        &self,
        effects: &[&str],
        chosen: &[&'static dyn Effect],
    ) -> Result<(Refit<'_>, Vec<f64>), DiagnosisError> {
        let (point, entered) = self.first_values(effects, chosen)?;
        let mut refit = self.own_parameters();
        for effect in chosen {
            refit.add(*effect, &point, entered.get(effect.info().id));
        }
        let units = refit.units_of(&point);
        Ok((refit, units))
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
        // As given; and near the end already, if the motion can be smoothed.
        let mut starts = vec![vec![0.0; refit.columns.len()]];
        starts.extend(self.smoothed().ok().map(|(_, point)| refit.units_of(point)));
        let (fitted, fit) = refit.fit(self.training, &starts, self.options)?;
        Ok(self.base.get_or_init(|| (fitted.at, fit)))
    }

    fn smoothed(&self) -> Result<&(Problem, Point), DiagnosisError> {
        if let Some(smoothed) = self.smoothed.get() {
            return Ok(smoothed);
        }
        let mut problem = self.problem.clone();
        let point = base_point_with(&mut problem, &mut None)?;
        Ok(self.smoothed.get_or_init(|| (problem, point)))
    }

    /// Values of these effects along the smoothed motion, and how they entered.
    fn first_values(
        &self,
        ids: &[&str],
        chosen: &[&'static dyn Effect],
    ) -> Result<(Point, BTreeMap<&'static str, Entered>), DiagnosisError> {
        let (problem, point) = self.smoothed()?;
        // Columns of effects that take no part need not be made.
        let others = catalogue().iter().map(|effect| effect.info().id).filter(|id| !ids.contains(id));
        let options = Options { exclude: others.map(str::to_owned).collect(), ..self.options.clone() };
        let mut problem = problem.clone();
        let mut search = Search::at(&mut problem, None, &options, point.clone())?;
        make_columns_for(&mut search, ids)?;
        search.adopt(chosen)?;
        let found = point_of(search.problem, &search.design, &search.point, &search.best);
        Ok((found, Entered::of(&search.design, &search.best.terms)))
    }
}
