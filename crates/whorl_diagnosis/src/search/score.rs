//! Scores of the sets that were fitted, and which of them is the present best.

use std::collections::BTreeMap;
use std::sync::Arc;

use whorl_prediction::{Fitted as FittedToSamples, Followed, Laws, Settings, hints};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::bins::motion::Motion;
use crate::evidence::ar_noise::{ArModels, alike};
use crate::evidence::nuisance::Nuisance;
use crate::evidence::regression::Normal;
use crate::explanations::candidates::Design;
use crate::explanations::hypothesis::{Hypothesis, Term};
use crate::parameters::{Column, Point, Reference};
use crate::refit::Refit;
use crate::search::Search;
use crate::search::prior::{is_no_leakage, log_prior, smaller_sets};
use crate::search::step::NO_FIT;

/// What a fit may still gain, over the predicted gain of its next step: the prediction is linear, and formulas are not.
pub(crate) const BENT: f64 = 4.0;

/// How a set explains the data at its own point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Score {
    /// Log evidence of training and held-out data together, errors of formulas and noise of unknown size integrated out;
    /// comparable between sets.
    pub log_evidence: f64,
    /// Log evidence of the training data alone, at the search's own noise.
    pub training_evidence: f64,
    /// Log likelihood of the training data where the set fits them best.
    pub log_likelihood: f64,
    /// Log likelihood of held-out data with values that were fitted to the training data.
    pub held_log_likelihood: Option<f64>,
    /// Whitened misfit of the training data, prior's penalty included.
    pub misfit: f64,
    /// By how much a further step would lower the misfit: of a fit that ended before its minimum.
    pub predicted_decrease: f64,
    /// Relative error of formulas that is likeliest.
    pub relative_error: f64,
    /// Noise beside the model's that is likeliest.
    pub nuisance: Nuisance,
}

impl Score {
    /// Log evidence, with the predicted gain of the next step of a fit that ended before its minimum, as far as a linear
    /// prediction is good.
    pub fn worth(&self, settings: &crate::Settings) -> f64 {
        self.log_evidence + (0.5 * self.predicted_decrease).min(settings.doubt_nats)
    }

    fn likelihoods(&self) -> Likelihoods {
        Likelihoods { training: self.log_likelihood, held_out: self.held_log_likelihood, numbers: 0 }
    }
}

/// How likely data are with a set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Likelihoods {
    /// Log likelihood of the training data.
    pub training: f64,
    /// Log likelihood of held-out data with values that were fitted to the training data; `None` without any.
    pub held_out: Option<f64>,
    /// How many numbers were read: of others the likelihoods are not comparable.
    pub numbers: usize,
}

impl Likelihoods {
    /// Gain over a smaller set. Held-out data, with values that were fitted to other data, may count against a set but not for it: what
    /// they would add scatters by as much as it is.
    pub fn gain(&self, base: &Self) -> f64 {
        let held = self.held_out.zip(base.held_out).map_or(0.0, |(set, base)| set - base);
        self.training - base.training + held.min(0.0)
    }

    /// Whether a set explains the training data better than a smaller one, and held-out data not worse where there are any:
    /// what does not let the error fall explains nothing. What held-out data say of a faint effect scatters: a log likelihood
    /// ratio has a variance of twice its mean, which is at most what the training data gained.
    pub fn explain_more(&self, base: &Self) -> bool {
        if self.numbers != base.numbers {
            return true;
        }
        let held = self.held_out.zip(base.held_out).map_or(0.0, |(set, base)| set - base);
        let gain = self.training - base.training;
        gain > 0.0 && held > -(2.0 * gain).sqrt()
    }
}

/// Sets that were fitted, by their names.
pub(crate) type Fitted = BTreeMap<Vec<String>, Converged>;

/// A set fitted at its own point.
#[derive(Debug, Clone)]
pub(crate) struct Converged {
    pub names: Vec<String>,
    pub score: Score,
    pub point: Point,
    pub motions: Arc<Vec<Motion>>,
    pub design: Design,
    pub terms: Vec<Term>,
    /// Standard deviation of each column of the design matrix, in its units; 0 = it takes no part.
    pub stddevs: Vec<f64>,
    /// ArModels with which it was evaluated, of training runs
    pub ar_models: ArModels,
    /// and of held-out ones.
    pub held_ar_models: Option<ArModels>,
    /// What the filter says of it at the rate of the samples, values integrated out, if it was asked.
    pub judged: Option<Judged>,
}

/// What the filter says of a set.
#[derive(Debug, Clone)]
pub(crate) struct Judged {
    pub likelihoods: Likelihoods,
    /// The effect that is fewest deviations from none.
    pub weakest: Option<String>,
    /// Where it was fitted.
    pub fit: Arc<JudgedFit>,
}

/// A set fitted to the samples.
#[derive(Debug, Clone)]
pub(crate) struct JudgedFit {
    pub fitted: FittedToSamples,
    /// What was fitted, and the standard deviation known before, in their units.
    pub columns: Vec<Column>,
    pub stddevs: Vec<f64>,
    /// Recordings that were held out, as the filter follows them with it; none of a set that gains nothing.
    pub held_out: Vec<Followed>,
}

impl JudgedFit {
    /// What was fitted, to add more to it or to find its models.
    pub fn refit<'a>(&self, reference: &'a Reference) -> Refit<'a> {
        Refit { reference, columns: self.columns.clone(), stddevs: self.stddevs.clone() }
    }

    /// Normal equations of the samples about the optimum of the fit, for the parameters of a refit that begins with the fitted ones,
    /// and for laws of each run; the parameters after the fitted ones are at zero.
    pub fn normal(
        &self,
        refit: &Refit<'_>,
        laws: &[Laws<'_>],
        training: &[Recording],
        threads: usize,
    ) -> Result<Normal, DiagnosisError> {
        let mut at = self.fitted.at.clone();
        at.resize(refit.columns.len(), 0.0);
        let parameters = refit.parameters();
        let model_at = |units: &[f64]| refit.model_at(units);
        let settings = Settings { threads, ..Settings::default() };
        let found = hints(training, &parameters, &model_at, &at, &self.fitted.followed, laws, &settings)?;
        let mut normal = Normal::zeros(found.slope.len());
        (normal.matrix, normal.vector) = (found.information, found.slope);
        // Relative to the present parameters, with the gradient of their prior.
        for (i, (units, parameter)) in at.iter().zip(&parameters).enumerate() {
            normal.vector[i] -= units / parameter.stddev.powi(2);
        }
        Ok(normal)
    }

    /// Standard deviation of the slow random torque beside it, root mean square of all axes and runs [N m].
    pub fn torque_n_m(&self) -> f64 {
        let runs = &self.fitted.followed;
        let squares = runs.iter().flat_map(|run| run.noise.disturbance.body_stddev_b_n_m()).map(|x| x * x);
        (squares.sum::<f64>() / (3 * runs.len()).max(1) as f64).sqrt()
    }
}

impl Converged {
    /// Whether it explains more than a smaller set: bins of the smoothed motion, and the samples themselves where both were asked.
    fn explains_more(&self, smaller: &Self) -> bool {
        match (&self.judged, &smaller.judged) {
            // Bins are means of the same samples: where both exist the samples decide.
            (Some(set), Some(smaller)) => set.likelihoods.explain_more(&smaller.likelihoods),
            _ => self.score.likelihoods().explain_more(&smaller.score.likelihoods()),
        }
    }

    /// Log posterior, up to a constant.
    pub fn log_posterior(&self) -> f64 {
        let settings = &self.design.settings;
        self.score.worth(settings) + log_prior(&self.names, settings)
    }
}

impl Search<'_> {
    /// Makes a converged set the present best: the full regression at its point, with its noise.
    pub(crate) fn settle(&mut self, converged: Converged) -> Result<(), DiagnosisError> {
        self.point = converged.point;
        self.problem.motions = converged.motions;
        self.problem.nuisance = converged.score.nuisance;
        self.relative_error = converged.score.relative_error;
        if let Some(held) = &mut self.held_out {
            held.nuisance = converged.score.nuisance;
        }
        self.regress()?;
        let terms: Vec<Term> =
            converged.terms.iter().filter_map(|m| m.carried(&converged.design, &self.design)).collect();
        self.best =
            Hypothesis::of(&self.design, &self.data.total, terms).unwrap_or_else(|| self.base.clone());
        // A set that loses a term at its own optimum explains nothing.
        if self.best.names(&self.design) != converged.names {
            self.forget(&converged.names);
        }
        Ok(())
    }

    /// These AR models of training runs, or those of a set evaluated before that agree within the scatter of estimates:
    /// evidence is best compared with the same noise models.
    pub(crate) fn ar_models_as_before(&self, ar_models: ArModels) -> ArModels {
        let known = std::iter::once(&self.sharp).chain(self.fitted.values().map(|set| &set.ar_models));
        or_alike(ar_models, known)
    }

    /// The same of held-out runs.
    pub(crate) fn held_ar_models_as_before(&self, ar_models: ArModels) -> ArModels {
        or_alike(ar_models, self.fitted.values().filter_map(|set| set.held_ar_models.as_ref()))
    }

    /// Keeps the best score of a set, unless the samples have judged it.
    pub(crate) fn remember(&mut self, mut converged: Converged) {
        self.watch_latency(&converged.names, converged.score.log_evidence, &converged.point);
        self.note_bins(&converged);
        converged.score.log_evidence += self.samples_over_bins;
        let is_better = |known: &Converged| {
            known.judged.is_none() && converged.score.log_evidence >= known.score.log_evidence
        };
        if self.fitted.get(&converged.names).is_none_or(is_better) {
            self.fitted.insert(converged.names.clone(), converged);
        }
    }

    /// Keeps the best log evidence in bins of a set.
    pub(crate) fn note_bins(&mut self, converged: &Converged) {
        let of_set = self.of_bins.entry(converged.names.clone()).or_insert(f64::NEG_INFINITY);
        *of_set = of_set.max(converged.score.log_evidence);
    }

    /// Compares a set no more.
    pub(crate) fn forget(&mut self, names: &[String]) {
        if let Some(set) = self.fitted.remove(names) {
            let set = self.traced_set(&set, 0.0);
            self.forgotten.push(set);
        }
    }

    /// Sets that were fitted and are admissible: that of no effects, and those that explain training and held-out data each
    /// better than it does and than each smaller set does that they hold, and by more than the misspecification leakage of what that explains.
    pub(crate) fn admissible(&self) -> impl Iterator<Item = &Converged> {
        self.fitted.values().filter(|set| set.names.is_empty() || self.is_admissible(set))
    }

    fn is_admissible(&self, set: &Converged) -> bool {
        let score = |names: &[String]| self.fitted.get(names).map(|c| c.score);
        let smaller = smaller_sets(&set.names).chain([Vec::new()]);
        let explains = |names: Vec<String>| self.fitted.get(&names).is_none_or(|s| set.explains_more(s));
        smaller.into_iter().all(explains)
            && is_no_leakage(&set.names, set.score.log_evidence, &self.options.settings, |names| {
                score(names).map(|s| s.log_evidence)
            })
    }

    /// The most probable admissible set.
    pub(crate) fn most_probable(&self) -> Option<&Converged> {
        self.admissible().max_by(|a, b| a.log_posterior().total_cmp(&b.log_posterior()))
    }

    /// Linearises anew at the present best and finds its terms there.
    pub(crate) fn relinearise(&mut self) -> Result<Score, DiagnosisError> {
        let best = self.best.clone();
        let converged = match self.converge(&best)? {
            Some(converged) => converged,
            // It has no fit at its own point: back to the base model.
            None => {
                let base = self.base.clone();
                self.converge(&base)?.ok_or(NO_FIT)?
            }
        };
        let score = converged.score;
        self.settle(converged)?;
        Ok(score)
    }

    /// A set where it fits best, if it was fitted there.
    pub(crate) fn fitted(&self, set: &Hypothesis) -> Option<&Converged> {
        self.fitted.get(&set.names(&self.design))
    }

    /// Score of a set, if it was fitted at a point of its own.
    pub(crate) fn score(&self, set: &Hypothesis) -> Option<Score> {
        self.fitted(set).map(|c| c.score)
    }

    /// Log evidence that one set has over another, and twice the log likelihood: where each fits best if both were
    /// fitted there, else in the present regression.
    pub(crate) fn advantage(&self, with: &Hypothesis, without: &Hypothesis) -> (f64, f64) {
        match (self.score(with), self.score(without)) {
            (Some(a), Some(b)) => {
                (a.log_evidence - b.log_evidence, 2.0 * (a.log_likelihood - b.log_likelihood))
            }
            _ => (with.log_evidence - without.log_evidence, with.estimate.drop - without.estimate.drop),
        }
    }
}

/// These AR models, or the first of those known that agree with them.
fn or_alike<'a>(ar_models: ArModels, mut known: impl Iterator<Item = &'a ArModels>) -> ArModels {
    known.find(|known| alike(known, &ar_models)).cloned().unwrap_or(ar_models)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lets_the_error_stand_explains_nothing() {
        let of = |training: f64, held_out: Option<f64>| Likelihoods { training, held_out, numbers: 100 };
        let base = of(-10.0, Some(-5.0));
        assert!(of(-2.0, Some(-4.0)).explain_more(&base));
        assert!(of(-2.0, Some(-5.5)).explain_more(&base));
        assert!(!of(-2.0, Some(-9.5)).explain_more(&base));
        assert!(!of(-11.0, Some(-4.0)).explain_more(&base));
        assert!(of(-2.0, None).explain_more(&of(-10.0, None)));
    }
}
