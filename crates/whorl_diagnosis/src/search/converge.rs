//! Fits sets of effects where they fit best, and remembers how well.
//!
//! The first regression is linearised where an effect is absent. There, a lag looks like a delay, a resonance has
//! the frequency of a grid point, and a signal extrapolated far to zero may have any size. So competing sets are each
//! fitted by Gauss-Newton steps, with motion and sensitivities computed anew at every step, and compared by their
//! evidence at their own optimum (Laplace's approximation).

use std::sync::Arc;

use nalgebra::DVector;
use whorl_dynamics::effects::find;

use crate::DiagnosisError;
use crate::bins::motion::Motion;
use crate::bins::run::Run;
use crate::evidence::ar_noise::{ArModels, alike};
use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::{Dataset, Problem, ProcessNoise};
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::candidates::Design;
use crate::explanations::hypothesis::{Hypothesis, Term};
use crate::explanations::lines::Lines;
use crate::explanations::physical::between;
use crate::parameters::Point;
use crate::search::Search;
use crate::search::noise_optimisation::{Noise, Sizes};
use crate::search::prior::of_other_law;
use crate::search::score::{BENT, Converged};
use crate::search::step::{dataset, point_of};

/// Steps of a fit, those taken back included.
const MOST_STEPS: usize = 8;

/// Fits of a set, each with the noise that is likeliest where the last one ended.
const MOST_TURNS: usize = 4;

/// Times that the first step of a fit is shortened.
const MOST_SHORTER: usize = 3;

/// Where Gauss-Newton steps of a set have come to, and the regression there.
pub(crate) struct Descended {
    pub names: Vec<String>,
    /// Log evidence of the training data alone, with the noise that the steps were taken with.
    pub log_evidence: f64,
    /// Whitened misfit of the training data, prior's penalty included.
    pub misfit: f64,
    /// By how much a further step would lower the misfit.
    pub predicted_decrease: f64,
    /// Noise that the steps were taken with.
    pub nuisance: Nuisance,
    pub point: Point,
    pub motions: Arc<Vec<Motion>>,
    pub design: Design,
    pub terms: Vec<Term>,
    /// Errors of formulas not integrated out.
    pub data: Dataset,
}

/// The initial guess of a fit.
#[derive(Clone)]
pub(super) struct InitialGuess {
    pub point: Point,
    pub design: Design,
    pub terms: Vec<Term>,
}

/// Misfit at a point itself, not where the regression's minimum is, and that point. Where an effect's shape is
/// fitted, all else follows it to where it fits best (variable projection, Golub and Pereyra 1973): a static
/// deflection that goes with a frequency must not be charged to a gravity offset that has not moved yet. `follows`: they
/// follow in any case, as needed for further data.
pub(crate) fn at_itself(
    search: &Search<'_>,
    design: &Design,
    total: &Normal,
    fit: &Hypothesis,
    point: &Point,
    follows: bool,
) -> Option<(f64, Point)> {
    let reference = &search.problem.reference;
    let variances = fit.variances(design);
    let variance = |i: usize| variances[i].max(1e-12);
    let (shapes, others): (Vec<usize>, Vec<usize>) =
        fit.estimate.active.iter().partition(|i| design.columns[**i].is_shape);
    let follows = follows || !shapes.is_empty();
    let mut at = DVector::zeros(design.columns.len());
    let mut penalty = 0.0;
    // What has left the fit stays where it is, too.
    for i in (0..design.columns.len()).filter(|i| !(follows && others.contains(i))) {
        at[i] = reference.distance(point, &design.columns[i]);
        if fit.estimate.active.contains(&i) {
            penalty += at[i] * at[i] / variance(i);
        }
    }
    let mut left = total.clone();
    let carried = &left.matrix * &at;
    left.sum_of_squares += at.dot(&carried) - 2.0 * at.dot(&left.vector);
    left.vector -= carried;
    if !follows {
        return Some((left.sum_of_squares + penalty, point.clone()));
    }
    let followed = Estimate::new(&left, &others, variance)?;
    let mut there = point.clone();
    for &i in &others {
        let column = &design.columns[i];
        there = reference.moved(&there, column, followed.of(i) - reference.distance(point, column));
    }
    Some((left.sum_of_squares - followed.drop + penalty, reference.towards(point, there)))
}

impl Search<'_> {
    /// Fits a set that holds in the present regression where it fits best. `None` if it cannot stand there.
    pub(crate) fn converge(&self, start: &Hypothesis) -> Result<Option<Converged>, DiagnosisError> {
        let noise = if start.terms.is_empty() { self.problem.nuisance } else { Nuisance::default() };
        self.converge_towards(start, noise, f64::NEG_INFINITY, self.problem.threads)
    }

    /// As [`Self::converge`], from no noise beside what the model states.
    pub(crate) fn converge_sharply(&self, start: &Hypothesis) -> Result<Option<Converged>, DiagnosisError> {
        self.converge_towards(start, Nuisance::default(), f64::NEG_INFINITY, self.problem.threads)
    }

    /// As [`Self::converge`], from this noise: with the noise that another set needs, a fit may not see this set at all, and
    /// then the noise stays. The fit is given up once it cannot come to a log evidence of `least` of the training data.
    fn converge_towards(
        &self,
        start: &Hypothesis,
        noise: Nuisance,
        least: f64,
        threads: usize,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let ids: Vec<&'static str> = start
            .terms
            .iter()
            .filter_map(|m| self.design.candidates.get(m.candidate).map(|c| c.id))
            .collect();
        // Along a motion of its own.
        let mut problem = self.problem.clone();
        problem.threads = threads;
        problem.nuisance = noise;
        let from = self.initial_guess(start, &ids);
        let found = self.fitted_with(problem.clone(), from.clone(), &ids, least, Sizes::Any)?;
        let is_beside_torque = |found: &Converged| problem.is_large(found.score.nuisance);
        let found = match found {
            Some(found) if !ids.is_empty() && is_beside_torque(&found) => found,
            other => return Ok(other),
        };
        // The misspecification leakage of a set looks like a random torque.
        let alone = self.fitted_with(problem, from, &ids, f64::NEG_INFINITY, Sizes::Background)?;
        let base = self.score(&self.base).map_or(f64::INFINITY, |base| base.log_evidence);
        let is_leakage = |alone: &Converged| {
            let explained = f64::max(alone.score.log_evidence - base, 0.0);
            found.score.log_evidence - alone.score.log_evidence
                <= of_other_law(&self.options.settings) * explained
        };
        Ok(Some(alone.filter(is_leakage).unwrap_or(found)))
    }

    /// A set where it fits best with noise of these sizes, and what it is worth there.
    pub(super) fn fitted_with(
        &self,
        mut problem: Problem,
        from: InitialGuess,
        ids: &[&'static str],
        least: f64,
        sizes: Sizes,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let Some((descended, noise)) = self.turns(&mut problem, from, ids, least, sizes)? else {
            return Ok(None);
        };
        Ok(DiagnosisError::possible(self.evaluated(descended, noise, &problem))?.flatten())
    }

    /// Alternates fits of a set with optimisations of the noise; returns the last fit and the noise that is likeliest there.
    fn turns(
        &self,
        problem: &mut Problem,
        mut from: InitialGuess,
        ids: &[&'static str],
        least: f64,
        sizes: Sizes,
    ) -> Result<Option<(Descended, Noise)>, DiagnosisError> {
        let mut last: Option<(Descended, Noise)> = None;
        // What another set needed may be needed here.
        let of_others: Vec<Nuisance> = self.fitted.values().map(|set| set.score.nuisance).collect();
        // Less noise makes a fit sharper, and a sharper fit leaves less noise.
        let mut ar_models = (problem.nuisance == Nuisance::default()).then(|| self.sharp.clone());
        for turn in 0..MOST_TURNS {
            let Some(descended) = self.descend(problem, from, ids, least, turn == 0, ar_models)? else {
                break;
            };
            problem.motions = Arc::clone(&descended.motions);
            let noise = problem.likeliest_noise(&descended.point, &of_others, sizes)?;
            from = InitialGuess {
                point: descended.point.clone(),
                design: descended.design.clone(),
                terms: descended.terms.clone(),
            };
            let is_settled =
                problem.nuisance == noise.sizes && alike(&descended.data.ar_models, &noise.ar_models);
            problem.nuisance = noise.sizes;
            ar_models = Some(noise.ar_models.clone());
            last = Some((descended, noise));
            if is_settled {
                break;
            }
        }
        Ok(last)
    }

    /// Fits several sets where each fits best, side by side; given up where they cannot come to a log evidence of
    /// `least`.
    pub(crate) fn converge_all(
        &self,
        starts: &[Hypothesis],
        least: f64,
    ) -> Result<Vec<Option<Converged>>, DiagnosisError> {
        let each = if starts.len() > 1 { 1 } else { self.problem.threads };
        crate::threads::map(self.problem.threads, starts, |start| {
            self.converge_towards(start, Nuisance::default(), least, each)
        })
        .into_iter()
        .collect()
    }

    /// The initial guess for the fit of a set that holds in the present regression.
    fn initial_guess(&self, start: &Hypothesis, ids: &[&'static str]) -> InitialGuess {
        let mut point = point_of(self.problem, &self.design, &self.point, start);
        self.keep_only(&mut point, ids);
        InitialGuess { point, design: self.design.clone(), terms: start.terms.clone() }
    }

    /// Effects that have left a set leave its point.
    pub(super) fn keep_only(&self, point: &mut Point, ids: &[&'static str]) {
        point.effects.retain(|id, _| {
            ids.contains(id)
                || crate::parameters::is_base(id)
                || self.problem.reference.model.effects.contains_key(*id)
        });
        self.problem.reference.withdraw(point, ids);
    }

    fn descend(
        &self,
        problem: &mut Problem,
        from: InitialGuess,
        ids: &[&'static str],
        least: f64,
        is_first: bool,
        mut ar_models: Option<ArModels>,
    ) -> Result<Option<Descended>, DiagnosisError> {
        let settings = &self.options.settings;
        let InitialGuess { mut point, mut design, mut terms } = from;
        let entered_as_place = terms.last().is_some_and(|m| {
            let of_last = m.columns.iter().filter_map(|i| design.columns.get(*i));
            of_last.clone().any(|c| c.origin.is_some()) && of_last.flat_map(|c| &c.step).all(|s| *s == 0.0)
        });
        let mut best: Option<Descended> = None;
        let (mut share, mut target): (f64, Option<Point>) = (1.0, None);
        // A set that holds the present best one starts from there, with a misfit that is known.
        let (anchor, first) = (self.point.clone(), point.clone());
        let of_best = self.best.names(&self.design);
        let holds_best = is_first && of_best.iter().all(|own| ids.contains(&own.as_str()));
        let mut allowed = self
            .score(&self.best)
            .filter(|s| holds_best && s.nuisance == problem.nuisance)
            .map_or(f64::INFINITY, |s| s.misfit + settings.clear_misfit);
        // Predicted decrease of the last good step.
        let mut predicted_decrease = 0.0;
        for step in 0..MOST_STEPS {
            let process_noise =
                if is_first && step == 0 { ProcessNoise::Estimated } else { ProcessNoise::Previous };
            let here =
                Design::of_effects(&self.problem.reference, &point, &self.available, ids, &Lines::default());
            let smoothed = problem.smooth(&point, process_noise);
            let made = smoothed.and_then(|()| dataset(problem, &point, &here, ar_models.clone()));
            let Some(data) = DiagnosisError::possible(made)? else { break };
            // Misfits are comparable only with the same AR models.
            ar_models = Some(data.ar_models.clone());
            terms = terms.iter().filter_map(|m| m.carried(&design, &here)).collect();
            design = here;
            let (total, gained) = problem.integrated(&data, &point, &design, self.relative_error);
            let Some(mut fit) = Hypothesis::of(&design, &total, terms.clone()) else { break };
            if fit.terms.len() < ids.len() {
                break;
            }
            // The effect entered at a grid point; now it has a value, and its distance from neutral is known for the first time.
            if step == 0 && entered_as_place {
                fit = fit.resized(&design, &total);
                terms.clone_from(&fit.terms);
            }
            let Some((misfit, here)) = at_itself(self, &design, &total, &fit, &point, false) else {
                break;
            };
            // A periodic torque with less than one period in every run is a drift.
            if !self.comes_round(&here) {
                return Ok(None);
            }
            // A larger set must not lose what the best set explains on the way: a contact's blows, for example, are far from
            // linear in all other parameters.
            if best.is_none() && misfit > allowed {
                share *= 0.4;
                point = between(&anchor, &first, share);
                if step + 1 == MOST_SHORTER {
                    (share, point, allowed) = (1.0, first.clone(), f64::INFINITY);
                }
                continue;
            }
            let last = best.as_ref().map_or(f64::INFINITY, |b| b.misfit);
            // A step that went too far is shortened, and so are those after it until one is good.
            if misfit > last + 2.0 * settings.converged_nats {
                share *= 0.4;
                // A share s of a step to the minimum of a parabola brings 1 - (1 - s)^2 of what the whole does.
                if share * (2.0 - share) * predicted_decrease < 2.0 * settings.converged_nats {
                    break;
                }
                let Some((back, target)) = best.as_ref().map(|b| &b.point).zip(target.as_ref()) else {
                    break;
                };
                point = between(back, target, share);
                continue;
            }
            share = (1.6 * share).min(1.0);
            let predicted = misfit - (total.sum_of_squares - fit.estimate.drop);
            // Occam's factor and the log-prior penalty of choices, beside the likelihood.
            let factor = fit.log_evidence - 0.5 * fit.estimate.drop + data.log_density + gained;
            let next = point_of(self.problem, &design, &point, &fit);
            let log_evidence = factor - 0.5 * misfit;
            predicted_decrease = predicted;
            best = Some(Descended {
                names: fit.names(&design),
                log_evidence,
                misfit,
                predicted_decrease: predicted.max(0.0),
                nuisance: problem.nuisance,
                point: here.clone(),
                motions: Arc::clone(&problem.motions),
                design: design.clone(),
                terms: fit.terms.clone(),
                data,
            });
            if predicted < 2.0 * settings.converged_nats
                || log_evidence + BENT * 0.5 * predicted + settings.doubt_nats < least
            {
                break;
            }
            point = between(&here, &next, share);
            target = Some(next);
        }
        Ok(best)
    }

    /// Whether a periodic torque has at least one period in the longest run.
    fn comes_round(&self, point: &Point) -> bool {
        let duration_s = |run: &Run| run.time(run.nodes().saturating_sub(1)) - run.time(0);
        let longest_s = self.problem.runs.iter().map(duration_s).fold(0.0, f64::max);
        let imposed_hz =
            |(id, values): (&&str, &Vec<f64>)| find(id).and_then(|effect| effect.imposed_hz(values));
        point.effects.iter().filter_map(imposed_hz).all(|hz| longest_s * hz >= 1.0)
    }
}
