//! The table of candidates: a row for each effect of the answer, and for each that was tried beside it.

use nalgebra::DVector;

use crate::diagnosis::{Candidate, ParameterEstimate};
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::hypothesis::Hypothesis;
use crate::search::Search;
use crate::search::sampled::Beside;

impl Search<'_> {
    /// One row for each effect: terms of the best set, then what else was tested, best first.
    pub(crate) fn rows(&self) -> Vec<Candidate> {
        let mut candidates: Vec<Candidate> = Vec::new();
        for term in 0..self.best.terms.len() {
            if let Some(smaller) = self.best.without(&self.design, &self.data.total, term)
                && let Some(mut row) = self.row(&self.best, &smaller, term)
            {
                if let Some(parameters) = self.averaged(&self.best, term) {
                    row.parameters = parameters;
                }
                candidates.push(row);
            }
        }
        let mut others: Vec<Candidate> =
            self.additions(&self.best).iter().filter_map(|a| self.row_beside(a)).collect();
        others.sort_by(|a, b| b.delta_log_evidence.total_cmp(&a.delta_log_evidence));
        candidates.extend(others);
        candidates
    }

    /// One row for the best set with an effect more. The samples tell what it gains where the set was not fitted to them: bins may
    /// promise more than the samples show.
    fn row_beside(&self, with: &Hypothesis) -> Option<Candidate> {
        let last = with.terms.len().checked_sub(1)?;
        let id = self.design.candidates.get(with.terms.get(last)?.candidate)?.id;
        let names = self.best.names(&self.design);
        let is_judged = self.fitted(with).is_some_and(|set| set.judged.is_some());
        let beside = self.besides.iter().find(|beside| beside.names == names && beside.holds_for(id));
        match beside.filter(|_| !is_judged) {
            Some(beside) => self.row_of_samples(beside, id),
            None => self.row(with, &self.best, last),
        }
    }

    /// The same from the sums of the samples beside the best set.
    fn row_of_samples(&self, beside: &Beside, id: &str) -> Option<Candidate> {
        let entry = beside.entry(id, &self.options.settings)?;
        let covariance = entry.estimate.covariance();
        let parameter = |i: &usize| {
            let column = beside.columns.get(*i)?;
            let at = entry.estimate.active.iter().position(|active| active == i)?;
            let stddev = covariance[(at, at)].max(0.0).sqrt();
            Some(self.estimate_of(column, beside.at.get(*i)? + entry.estimate.value[at], stddev))
        };
        let base: Vec<usize> = beside.own.iter().copied().filter(|i| !entry.columns.contains(i)).collect();
        let variance = |i: usize| beside.stddevs[i].powi(2);
        Some(Candidate {
            effect: id.to_owned(),
            delta_log_evidence: entry.gain - beside.without.log_evidence,
            held_out_gain: None,
            share_of_excess: self.share_of_excess(entry.drop),
            swallowed_by_base: absorbed(&beside.normal, &entry.columns, &entry.estimate, &base, variance),
            detectability: entry.drop.max(0.0),
            indistinguishable_from: Vec::new(),
            parameters: entry.columns.iter().filter_map(parameter).collect(),
        })
    }

    /// One row of the table for a hypothesis' last term, against the hypothesis without it.
    fn row(&self, with: &Hypothesis, without: &Hypothesis, term: usize) -> Option<Candidate> {
        let term = with.terms.get(term)?;
        let candidate = self.design.candidates.get(term.candidate)?;
        let covariance = with.estimate.covariance();
        let mut parameters: Vec<ParameterEstimate> = Vec::new();
        for &i in &term.columns {
            let column = self.design.columns.get(i)?;
            let Some(at) = with.estimate.active.iter().position(|a| *a == i) else { continue };
            let stddev = covariance[(at, at)].max(0.0).sqrt();
            let own = self.estimate_of(column, with.estimate.value[at], stddev);
            // Sine and cosine of one amplitude.
            if let Some(sine) = parameters.iter_mut().find(|p| p.name == column.name) {
                sine.estimate = sine.estimate.hypot(own.estimate);
                sine.stddev = sine.stddev.max(own.stddev);
                continue;
            }
            parameters.push(own);
        }
        let (evidence, drop) = self.advantage(with, without);
        let base: Vec<usize> =
            self.design.base.iter().copied().filter(|i| !term.columns.contains(i)).collect();
        let variance = |i: usize| self.design.base_variance(i);
        Some(Candidate {
            effect: candidate.id.to_owned(),
            delta_log_evidence: evidence,
            held_out_gain: self.gain(with, without),
            share_of_excess: self.share_of_excess(drop),
            swallowed_by_base: absorbed(&self.data.total, &term.columns, &with.estimate, &base, variance),
            detectability: drop.max(0.0),
            indistinguishable_from: Vec::new(),
            parameters,
        })
    }

    /// Share of a drop of the misfit in what the best set brings and what it leaves, each with the noise that it leaves; both in the bins,
    /// of which a row of the samples is a share too.
    fn share_of_excess(&self, drop: f64) -> f64 {
        let rows = self.data.total.rows;
        // Where nothing is named, what is within chance is no excess.
        let chance = if self.best.terms.is_empty() {
            self.options.settings.noticed_stddevs * (2.0 * rows).sqrt()
        } else {
            1.0
        };
        let left = (self.data.total.sum_of_squares - self.best.estimate.drop - rows).max(0.0);
        let excess = (self.advantage(&self.best, &self.base).1 + left).max(chance).max(drop);
        (drop / excess).clamp(0.0, 1.0)
    }
}

/// Share of the signal of some columns that refitting the base absorbs.
fn absorbed(
    normal: &Normal,
    columns: &[usize],
    estimate: &Estimate,
    base: &[usize],
    base_variance: impl Fn(usize) -> f64,
) -> f64 {
    let of_columns: DVector<f64> = columns.iter().map(|j| normal.matrix.column(*j) * estimate.of(*j)).sum();
    let alone: f64 = columns.iter().map(|i| estimate.of(*i) * of_columns[*i]).sum();
    // What is left of the signal when the base follows it as well as it can within its prior.
    let signal = Normal { vector: of_columns, ..normal.clone() };
    let followed = Estimate::new(&signal, base, base_variance).map_or(0.0, |followed| followed.drop);
    if alone > 0.0 { (followed / alone).clamp(0.0, 1.0) } else { 0.0 }
}
