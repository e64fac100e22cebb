//! What a set of explanations is worth: its evidence where it fits best.
//!
//! log p(data | set) by Laplace's approximation at the set's own optimum, for training and held-out data together: held-out
//! runs are more data, and what they add is their predictive density. Errors of formulas are integrated out
//! ([`crate::evidence::discrepancy`]); the noise beside what the model states is the likeliest beside this set
//! ([`crate::evidence::nuisance`]).

use nalgebra::DVector;
use whorl_dynamics::effects::{BasePrior, Role};

use crate::DiagnosisError;
use crate::evidence::discrepancy::{Discrepancy, RELATIVE_ERRORS, Signal};
use crate::evidence::nuisance::Nuisance;
use crate::evidence::regression::Normal;
use crate::explanations::candidates::Layout;
use crate::explanations::hypothesis::Hypothesis;
use crate::explanations::parameters::{Column, Point, Target, is_base};
use crate::search::Search;
use crate::search::converge::{Converged, Standing, at_itself};
use crate::search::problem::{Dataset, Problem};
use crate::search::step::dataset;

/// What a column is an input of: known signals that enter by the platform's own constants.
fn input_of(problem: &Problem, column: &Column) -> Option<usize> {
    let Target::Effect(effect) = column.target else { return None };
    let spec = effect.parameters(&problem.reference.model).into_iter().nth(column.index)?;
    match spec.base? {
        BasePrior::JetThrust => Some(0),
        BasePrior::WheelSpinInertia => Some(1 + spec.part.index()?),
        _ => None,
    }
}

impl Problem {
    /// The signals that may differ slowly from their formulas: of each effect that a point holds, of the jets together and
    /// of each wheel.
    pub(crate) fn signals(&self, point: &Point, layout: &Layout) -> Vec<Signal> {
        let mut named: Vec<(String, Signal)> = Vec::new();
        for (i, column) in layout.columns.iter().enumerate() {
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
    pub(crate) fn discrepancy(&self, data: &Dataset, point: &Point, layout: &Layout) -> Discrepancy {
        let node_s: Vec<f64> = self.runs.iter().map(crate::layout::run::Run::node_s).collect();
        let signals = self.signals(point, layout);
        Discrepancy::new(&data.whitened, &node_s, &signals, layout.columns.len(), self.threads)
    }
}

/// Regressions of training and held-out data at one point.
struct Both {
    data: Dataset,
    of_data: Discrepancy,
    held: Option<(Dataset, Discrepancy)>,
}

impl Both {
    /// Normal equations of the training data, of all data, and what errors of this size add to the log densities.
    fn integrated(&self, relative_error: f64) -> (Normal, f64, Normal, f64) {
        let (training, log_density) = self.of_data.integrated(&self.data.total, relative_error);
        let mut all = training.clone();
        let mut log_density_of_all = log_density;
        if let Some((held, of_held)) = &self.held {
            let (more, log_density) = of_held.integrated(&held.total, relative_error);
            all.add(&more, 1.0);
            log_density_of_all += log_density + held.log_density;
        }
        let own = self.data.log_density;
        (training, log_density + own, all, log_density_of_all + own)
    }
}

impl Search<'_> {
    /// Weighs a set where it fits best.
    pub(crate) fn weighed(
        &self,
        mut converged: Converged,
        mut problem: Problem,
    ) -> Result<Option<Converged>, DiagnosisError> {
        let (point, layout) = (&converged.point, &converged.layout);
        problem.motions.clone_from(&converged.motions);
        problem.nuisance = problem.likeliest_nuisance(point, self.colours.as_deref())?;
        let data = dataset(&problem, point, layout, self.colours.clone())?;
        let of_data = problem.discrepancy(&data, point, layout);
        let held = match self.held_out.as_deref() {
            Some(held) => {
                let mut held = held.clone();
                (held.threads, held.nuisance) = (problem.threads, problem.nuisance);
                held.smooth(point, None)?;
                let data = dataset(&held, point, layout, self.held_colours.clone())?;
                let of_data = held.discrepancy(&data, point, layout);
                Some((data, of_data))
            }
            None => None,
        };
        let both = Both { data, of_data, held };
        let mut weights: Vec<(f64, Standing)> = Vec::new();
        for relative_error in RELATIVE_ERRORS {
            if let Some(standing) = self.standing_with(&converged, &both, relative_error, problem.nuisance) {
                weights.push((standing.log_evidence, standing));
            }
        }
        let Some((most, best)) = weights.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Ok(None);
        };
        // Each error is as likely as the others.
        let sum: f64 = weights.iter().map(|(evidence, _)| (evidence - most).exp()).sum();
        let choices = (RELATIVE_ERRORS.len() as f64).ln();
        converged.standing = Standing {
            log_evidence: most + sum.ln() - choices + problem.nuisance.log_prior(),
            promise: converged.standing.promise,
            training_evidence: converged.standing.training_evidence,
            ..best
        };
        Ok(Some(converged))
    }

    /// How a set stands with formulas that err by so much.
    fn standing_with(
        &self,
        converged: &Converged,
        both: &Both,
        relative_error: f64,
        nuisance: Nuisance,
    ) -> Option<Standing> {
        let (point, layout) = (&converged.point, &converged.layout);
        let (training, log_density, all, log_density_of_all) = both.integrated(relative_error);
        let own = Hypothesis::free(layout, &training, converged.members.clone())?;
        let (misfit, at) = at_itself(self, layout, &training, &own, point, false)?;
        let joint = Hypothesis::of(layout, &all, converged.members.clone())?.resized(layout, &all);
        if joint.members.len() < converged.members.len() {
            return None;
        }
        let (joint_misfit, _) = at_itself(self, layout, &all, &joint, &at, true)?;
        // Occam's factor and the price of choices, beside the likelihood.
        let occam = joint.log_evidence - 0.5 * joint.estimate.drop;
        let mut values = DVector::zeros(layout.columns.len());
        for (slot, column) in values.iter_mut().zip(&layout.columns) {
            *slot = self.problem.reference.distance(&at, column);
        }
        let misfit_of = |normal: &Normal| {
            normal.sum_of_squares - 2.0 * values.dot(&normal.vector) + values.dot(&(&normal.matrix * &values))
        };
        let held_log_likelihood = both.held.as_ref().map(|_| {
            let mut held = all.clone();
            held.add(&training, -1.0);
            log_density_of_all - log_density - 0.5 * misfit_of(&held)
        });
        Some(Standing {
            log_evidence: occam + log_density_of_all - 0.5 * joint_misfit,
            training_evidence: f64::NEG_INFINITY,
            log_likelihood: log_density - 0.5 * misfit,
            held_log_likelihood,
            misfit,
            promise: 0.0,
            relative_error,
            nuisance,
        })
    }
}
