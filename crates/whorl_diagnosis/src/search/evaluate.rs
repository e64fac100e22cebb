//! What a set of explanations is worth: its evidence where it fits best.
//!
//! log p(data | set) by Laplace's approximation at the set's own optimum, for training and held-out data together: held-out
//! runs are more data, and what they add is their predictive density. Errors of formulas are integrated out
//! ([`crate::evidence::discrepancy`]); the noise beside what the model states is the likeliest beside this set
//! ([`crate::evidence::nuisance`]).

use std::sync::Arc;

use nalgebra::DVector;
use whorl_dynamics::effects::{BasePrior, Role};

use crate::DiagnosisError;
use crate::evidence::discrepancy::{Discrepancy, Signal};
use crate::evidence::problem::{Dataset, Problem, ProcessNoise};
use crate::evidence::regression::Normal;
use crate::explanations::candidates::Design;
use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::{Column, Point, Target, is_base};
use crate::search::Search;
use crate::search::converge::{Descended, at_itself};
use crate::search::noise_optimisation::Noise;
use crate::search::score::{Converged, Score};
use crate::search::step::dataset;

/// Index of the known input (the jets, then wheels, then rotors of gyros) of which a column is the constant.
fn input_of(problem: &Problem, column: &Column) -> Option<usize> {
    let Target::Effect(effect) = column.target else { return None };
    let spec = effect.parameters(&problem.reference.model).into_iter().nth(column.index)?;
    match spec.base? {
        BasePrior::JetThrust => Some(0),
        BasePrior::WheelSpinInertia => Some(1 + spec.part.index()?),
        BasePrior::RotorMomentum => Some(1 + problem.reference.model.wheels().len() + spec.part.index()?),
        _ => None,
    }
}

impl Problem {
    /// The signals that may differ slowly from their formulas: of each effect that a point holds, of the jets together and
    /// of each wheel.
    pub(crate) fn signals(&self, point: &Point, design: &Design) -> Vec<Signal> {
        let mut named: Vec<(String, Signal)> = Vec::new();
        for (i, column) in design.columns.iter().enumerate() {
            let Target::Effect(effect) = column.target else { continue };
            let (name, size) = if let Some(input) = input_of(self, column) {
                // All of the signal: a relative change by one.
                (format!("input {input}"), 1.0 / column.scale)
            } else if is_base(column.group) || !point.effects.contains_key(column.group) {
                continue;
            } else {
                let specs = effect.parameters(&self.reference.model);
                let (Some(spec), Some(now)) = (
                    specs.get(column.index),
                    self.reference.values_at(point, effect).get(column.index).copied(),
                ) else {
                    continue;
                };
                if spec.role != Role::Amplitude || column.origin.is_some() {
                    continue;
                }
                (column.group.to_owned(), (now - spec.neutral) / column.scale)
            };
            if size == 0.0 || !size.is_finite() {
                continue;
            }
            match named.iter_mut().find(|(other, _)| *other == name) {
                Some((_, signal)) => signal.push((i, size)),
                None => named.push((name, vec![(i, size)])),
            }
        }
        named.into_iter().map(|(_, signal)| signal).collect()
    }

    /// What is needed to integrate over errors of formulas in a regression at a point.
    pub(crate) fn discrepancy(&self, data: &Dataset, point: &Point, design: &Design) -> Discrepancy {
        let node_s: Vec<f64> = self.runs.iter().map(crate::bins::run::Run::node_s).collect();
        let signals = self.signals(point, design);
        let block_s = self.reference.settings.model_discrepancy_s;
        Discrepancy::new(&data.whitened, &node_s, &signals, design.columns.len(), block_s, self.threads)
    }

    /// The normal equations of a regression with errors of formulas of this relative size integrated out, and what the
    /// log density gains.
    pub(crate) fn integrated(
        &self,
        data: &Dataset,
        point: &Point,
        design: &Design,
        relative_error: f64,
    ) -> (Normal, f64) {
        if relative_error <= 0.0 {
            return (data.total.clone(), 0.0);
        }
        self.discrepancy(data, point, design).integrated(&data.total, relative_error)
    }
}

/// Regressions of training and held-out data where a set fits best.
struct Both<'a> {
    set: &'a Descended,
    of_data: Discrepancy,
    held: Option<(Dataset, Discrepancy)>,
}

impl Both<'_> {
    /// Normal equations of the training data, of all data, and what errors of this size add to the log densities.
    fn integrated(&self, relative_error: f64) -> (Normal, f64, Normal, f64) {
        let (training, log_density) = self.of_data.integrated(&self.set.data.total, relative_error);
        let mut all = training.clone();
        let mut log_density_of_all = log_density;
        if let Some((held, of_held)) = &self.held {
            let (more, log_density) = of_held.integrated(&held.total, relative_error);
            all.add(&more, 1.0);
            log_density_of_all += log_density + held.log_density;
        }
        let own = self.set.data.log_density;
        (training, log_density + own, all, log_density_of_all + own)
    }
}

/// Standard deviation of each column in a fit; 0 = it takes no part.
fn deviations(fit: &Hypothesis, columns: usize) -> Vec<f64> {
    let covariance = fit.estimate.covariance();
    let mut stddevs = vec![0.0; columns];
    for (at, column) in fit.estimate.active.iter().enumerate() {
        stddevs[*column] = covariance[(at, at)].max(0.0).sqrt();
    }
    stddevs
}

impl Search<'_> {
    /// Evaluates a set where it fits best, with the noise that is likeliest there.
    pub(crate) fn evaluated(
        &self,
        mut set: Descended,
        mut noise: Noise,
        problem: &Problem,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let mut problem = problem.clone();
        problem.motions = Arc::clone(&set.motions);
        problem.nuisance = noise.sizes;
        noise.ar_models = self.ar_models_as_before(noise.ar_models);
        if set.nuisance != noise.sizes || set.data.ar_models != noise.ar_models {
            set.data = dataset(&problem, &set.point, &set.design, Some(noise.ar_models))?;
            set.nuisance = noise.sizes;
        }
        let of_data = problem.discrepancy(&set.data, &set.point, &set.design);
        let held = match self.held_out.as_deref() {
            Some(held) => {
                let mut held = held.clone();
                (held.threads, held.nuisance) = (problem.threads, problem.nuisance);
                held.smooth(&set.point, ProcessNoise::Estimated)?;
                let ar_models = self.held_ar_models_as_before(held.ar_models_at(&set.point)?);
                let data = dataset(&held, &set.point, &set.design, Some(ar_models))?;
                let of_data = held.discrepancy(&data, &set.point, &set.design);
                Some((data, of_data))
            }
            None => None,
        };
        let both = Both { set: &set, of_data, held };
        let discrepancies = &self.options.settings.model_discrepancies;
        let scores: Vec<(Score, Hypothesis)> =
            discrepancies.iter().filter_map(|error| self.score_with(&both, *error)).collect();
        let of = |score: &(Score, Hypothesis)| score.0.log_evidence;
        let Some((best, fit)) = scores.iter().max_by(|a, b| of(a).total_cmp(&of(b))) else {
            return Ok(None);
        };
        // Each error is as likely as the others.
        let sum: f64 = scores.iter().map(|s| (of(s) - best.log_evidence).exp()).sum();
        let choices = (discrepancies.len() as f64).ln();
        let score = Score {
            log_evidence: best.log_evidence + sum.ln() - choices + problem.log_prior(set.nuisance),
            ..*best
        };
        let stddevs = deviations(fit, set.design.columns.len());
        let held_ar_models = both.held.map(|(data, _)| data.ar_models);
        let Descended { names, point, motions, design, terms, data, .. } = set;
        let ar_models = data.ar_models;
        Ok(Some(Converged {
            names,
            score,
            point,
            motions,
            design,
            terms,
            stddevs,
            ar_models,
            held_ar_models,
            judged: None,
        }))
    }

    /// Score of a set with formulas of this relative error, and its fit to the training data.
    fn score_with(&self, both: &Both<'_>, relative_error: f64) -> Option<(Score, Hypothesis)> {
        let set = both.set;
        let design = &set.design;
        let (training, log_density, all, log_density_of_all) = both.integrated(relative_error);
        let own = Hypothesis::free(design, &training, set.terms.clone())?;
        let (misfit, at) = at_itself(self, design, &training, &own, &set.point, false)?;
        let joint = Hypothesis::of(design, &all, set.terms.clone())?.resized(design, &all);
        if joint.terms.len() < set.terms.len() {
            return None;
        }
        let (joint_misfit, _) = at_itself(self, design, &all, &joint, &at, true)?;
        // Occam's factor and the log-prior penalty of choices, beside the likelihood.
        let occam = joint.log_evidence - 0.5 * joint.estimate.drop;
        let mut values = DVector::zeros(design.columns.len());
        for (slot, column) in values.iter_mut().zip(&design.columns) {
            *slot = self.problem.reference.distance(&at, column);
        }
        let held_log_likelihood = both.held.as_ref().map(|_| {
            let mut held = all.clone();
            held.add(&training, -1.0);
            log_density_of_all - log_density - 0.5 * held.misfit_at(&values)
        });
        let score = Score {
            log_evidence: occam + log_density_of_all - 0.5 * joint_misfit,
            training_evidence: set.log_evidence,
            log_likelihood: log_density - 0.5 * misfit,
            held_log_likelihood,
            misfit,
            predicted_decrease: set.predicted_decrease,
            relative_error,
            nuisance: set.nuisance,
        };
        Some((score, own))
    }
}
