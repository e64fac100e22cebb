//! Models refitted jointly with effects that were chosen.

use whorl_dynamics::effects::{catalogue, find};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::evidence::problem::Problem;
use crate::parameters::Point;
use crate::search::Search;
use crate::search::prospect::make_columns_for;
use crate::search::step::base_point_with;
use crate::{DiagnosisError, Options, SlowResidual, prepare};

/// A model refitted jointly with effects.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The platform with base parameters and effects at their estimates.
    pub model: PlatformModel,
    /// Standard deviations after the fit.
    pub prior: ModelPrior,
    /// Every fitted parameter of the base model and of the effects.
    pub estimates: Vec<FittedParameter>,
    /// The slow residual before and after.
    pub slow_residual: SlowResidual,
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Effect id; `mass_properties` for the moments of inertia.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Value in the given model (for an effect that it does not have: the neutral value).
    pub before: f64,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation of the estimate: no more than was known before, more than the posterior's where the fit leaves
    /// something unexplained.
    pub stddev: f64,
    /// Standard deviation of the posterior itself, of the prior that the fit used and data without anything unexplained.
    pub posterior_stddev: f64,
    /// Whether the estimate lies at a bound of its plausible range.
    pub at_bound: bool,
}

/// Refits the platform's own parameters together with `effects` (ids of the catalogue, empty to refit the
/// base only) to the training recordings.
///
/// # Errors
/// As [`crate::diagnose`]; also for an unknown effect.
pub fn fit(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    effects: &[&str],
    options: &Options,
) -> Result<Fit, DiagnosisError> {
    Fitter::new(training, held_out, model, prior, options)?.fit(effects)
}

/// Recordings and a model, to be refitted with one set of effects after the other.
pub struct Fitter<'a> {
    options: &'a Options,
    problem: Problem,
    held_out: Option<Problem>,
    /// The base model fitted along a smoothed motion: every fit begins there.
    point: Point,
}

impl<'a> Fitter<'a> {
    /// Smooths the motion of the recordings and fits the base model.
    ///
    /// # Errors
    /// As [`crate::diagnose`].
    pub fn new(
        training: &[Recording],
        held_out: &[Recording],
        model: &PlatformModel,
        prior: &ModelPrior,
        options: &'a Options,
    ) -> Result<Self, DiagnosisError> {
        let (mut problem, mut held_out) =
            prepare(training, held_out, model, prior, options, None, &mut |_| {})?;
        let point = base_point_with(&mut problem, &mut held_out.as_mut())?;
        Ok(Self { options, problem, held_out, point })
    }

    /// Refits the platform's own parameters together with `effects`, ids of the catalogue. Every fit begins anew: the order
    /// of calls does not matter.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn fit(&self, effects: &[&str]) -> Result<Fit, DiagnosisError> {
        let mut chosen = Vec::new();
        for id in effects {
            chosen.push(find(id).ok_or_else(|| DiagnosisError::UnknownEffect { id: (*id).to_owned() })?);
        }
        // Columns of effects that take no part need not be made.
        let others = catalogue().iter().map(|effect| effect.info().id).filter(|id| !effects.contains(id));
        let options = Options { exclude: others.map(str::to_owned).collect(), ..self.options.clone() };
        let (mut problem, mut held_out) = (self.problem.clone(), self.held_out.clone());
        let mut search = Search::at(&mut problem, held_out.as_mut(), &options, self.point.clone())?;
        make_columns_for(&mut search, effects)?;
        search.adopt(&chosen)?;
        search.fit()
    }
}
