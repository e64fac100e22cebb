//! The table of candidates: a row for each effect of the answer, and for each that was compared beside it.

use whorl_dynamics::effects::{Role, find};
use whorl_prediction::Followed;

use crate::fitting::normal_equations::{Estimate, Normal};
use crate::selection::{Beside, Evaluated, Selection};
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

/// Of the drop of the misfit that an answer brings, and of what it leaves: see [`Candidate::share_of_excess`].
struct Excess(f64);

impl Excess {
    fn of(selection: &Selection<'_>, best: &Evaluated) -> Self {
        let base = selection.base();
        let left: f64 = best.fitted.followed.iter().map(|run| 2.0 * run.gain_nats.max(0.0)).sum();
        let numbers: usize = best.fitted.followed.iter().map(|run| run.undisturbed_likelihood.numbers).sum();
        // Where nothing is named, what is within chance is no excess.
        let noticed = selection.runs.reference.settings.noticed_stddevs;
        let chance = if best.names().is_empty() { noticed * (2.0 * numbers as f64).sqrt() } else { 1.0 };
        Self((drop_over(best, base) + left).max(chance))
    }

    fn share(&self, drop: f64) -> f64 {
        (drop / self.0.max(drop)).clamp(0.0, 1.0)
    }
}

/// By how much twice the log likelihood with a set exceeds that of another one that goes without a random torque.
fn drop_over(set: &Evaluated, other: &Evaluated) -> f64 {
    let loud: f64 = set.fitted.followed.iter().map(Followed::log_likelihood).sum();
    let quiet: f64 = other.fitted.followed.iter().map(|run| run.undisturbed_likelihood.log).sum();
    2.0 * (loud - quiet)
}

/// One row for each effect: those of the best set, then what else was compared with it, best first.
pub(super) fn rows(
    selection: &Selection<'_>,
    best: &Evaluated,
    beside: Option<&Beside<'_>>,
) -> Vec<Candidate> {
    let excess = Excess::of(selection, best);
    let mut rows: Vec<Candidate> =
        best.names().iter().filter_map(|id| row_of_member(selection, best, id, beside, &excess)).collect();
    let mut others: Vec<Candidate> = beside
        .iter()
        .flat_map(|beside| beside.effects().filter_map(|id| row_beside(selection, best, beside, id, &excess)))
        .collect();
    others.sort_by(|a, b| b.delta_log_evidence.total_cmp(&a.delta_log_evidence));
    rows.extend(others);
    rows
}

/// An effect of the best set, against the set without it.
fn row_of_member(
    selection: &Selection<'_>,
    best: &Evaluated,
    id: &'static str,
    beside: Option<&Beside<'_>>,
    excess: &Excess,
) -> Option<Candidate> {
    let names: Vec<&str> = best.names().iter().copied().filter(|other| *other != id).collect();
    let smaller = selection.set(&names);
    let own: Vec<usize> = (0..best.columns.len()).filter(|i| best.columns[*i].group == id).collect();
    let linear = || beside.map(|beside| without_columns(best, &own, beside)).unwrap_or_default();
    let (delta_log_evidence, drop) = match smaller {
        Some(smaller) => (best.log_evidence - smaller.log_evidence, drop_over(best, smaller)),
        None => linear(),
    };
    let has_held_out = !selection.runs.held_out.is_empty();
    let held_out_gain =
        smaller.filter(|_| has_held_out).map(|smaller| best.held_out_log - smaller.held_out_log);
    Some(Candidate {
        effect: id.to_owned(),
        delta_log_evidence,
        held_out_gain,
        share_of_excess: excess.share(drop),
        swallowed_by_base: beside.map_or(0.0, |beside| absorbed(best, &own, beside)),
        detectability: drop.max(0.0),
        indistinguishable_from: Vec::new(),
        parameters: own.iter().map(|i| estimate(selection, best, *i)).collect(),
    })
}

/// A fitted parameter.
fn estimate(selection: &Selection<'_>, set: &Evaluated, i: usize) -> ParameterEstimate {
    let (column, fitted) = (&set.columns[i], &set.fitted);
    let reference = selection.runs.reference;
    let point = set.refit(reference).point(&fitted.at);
    let stddev = fitted.covariance[(i, i)].max(0.0).sqrt() * column.scale;
    ParameterEstimate {
        name: column.name.clone(),
        unit: column.unit.to_owned(),
        estimate: reference.value_at(&point, column),
        stddev,
        at_bound: fitted.at_bound.get(i).copied().unwrap_or(false),
        smallest_detectable: 5.0 * stddev,
    }
}

/// The normal equations of the best set's own columns.
fn own_normal(best: &Evaluated, beside: &Beside<'_>) -> Normal {
    let own = best.columns.len();
    let mut normal = Normal::zeros(own);
    for of_run in beside.by_run() {
        normal.matrix += of_run.information.view((0, 0), (own, own));
    }
    normal
}

/// Log evidence and drop of the misfit that some columns of a set bring, about its optimum. Without its amplitudes an effect does nothing, whatever
/// its other values are: these are no part of it.
fn without_columns(best: &Evaluated, out: &[usize], beside: &Beside<'_>) -> (f64, f64) {
    // Of data that the optimum explains exactly.
    let mut normal = own_normal(best, beside);
    normal.vector = &normal.matrix * nalgebra::DVector::from_column_slice(&best.fitted.at);
    let variance = |i: usize| best.stddevs[i].powi(2);
    let is_amplitude = |i: &usize| best.columns[*i].role == Role::Amplitude;
    let kept: Vec<usize> = (0..best.columns.len()).filter(|i| !out.contains(i)).collect();
    let all: Vec<usize> = kept.iter().copied().chain(out.iter().copied().filter(is_amplitude)).collect();
    for i in out.iter().filter(|i| !is_amplitude(i)) {
        normal.vector -= normal.matrix.column(*i) * best.fitted.at[*i];
    }
    match (Estimate::new(&normal, &all, variance), Estimate::new(&normal, &kept, variance)) {
        (Some(with), Some(without)) => (with.log_evidence - without.log_evidence, with.drop - without.drop),
        _ => (0.0, 0.0),
    }
}

/// Share of what some columns of a set do that its others follow.
fn absorbed(best: &Evaluated, columns: &[usize], beside: &Beside<'_>) -> f64 {
    let normal = own_normal(best, beside);
    let at = &best.fitted.at;
    let is_amplitude = |i: &&usize| best.columns[**i].role == Role::Amplitude;
    let of_columns: nalgebra::DVector<f64> =
        columns.iter().filter(is_amplitude).map(|i| normal.matrix.column(*i) * at[*i]).sum();
    if of_columns.is_empty() {
        return 0.0;
    }
    let alone: f64 = columns.iter().filter(is_amplitude).map(|i| at[*i] * of_columns[*i]).sum();
    let others: Vec<usize> = (0..best.columns.len()).filter(|i| !columns.contains(i)).collect();
    let signal = Normal { vector: of_columns, ..normal };
    let followed = Estimate::new(&signal, &others, |i| best.stddevs[i].powi(2)).map_or(0.0, |of| of.drop);
    if alone > 0.0 { (followed / alone).clamp(0.0, 1.0) } else { 0.0 }
}

/// An effect that the best set does not hold: as it was fitted with it, else as the samples predict it.
fn row_beside(
    selection: &Selection<'_>,
    best: &Evaluated,
    beside: &Beside<'_>,
    id: &'static str,
    excess: &Excess,
) -> Option<Candidate> {
    let mut names: Vec<&str> = best.names().iter().copied().chain([id]).collect();
    names.sort_unstable();
    if let Some(larger) = selection.set(&names) {
        let own: Vec<usize> = (0..larger.columns.len()).filter(|i| larger.columns[*i].group == id).collect();
        let drop = drop_over(larger, best) - drop_over(best, best);
        let has_held_out = !selection.runs.held_out.is_empty();
        return Some(Candidate {
            effect: id.to_owned(),
            delta_log_evidence: larger.log_evidence - best.log_evidence,
            held_out_gain: has_held_out.then_some(larger.held_out_log - best.held_out_log),
            share_of_excess: excess.share(drop),
            swallowed_by_base: beside.entering(id).map_or(0.0, |entering| beside.absorbed(&entering)),
            detectability: drop.max(0.0),
            indistinguishable_from: Vec::new(),
            parameters: own.iter().map(|i| estimate(selection, larger, *i)).collect(),
        });
    }
    let is_hidden = find(id).is_some_and(|effect| effect.hidden_states(&selection.runs.reference.model) > 0);
    let entering = beside.entering(id)?;
    let parameters = beside.values(&entering).into_iter().map(|(name, unit, estimate, stddev, at_bound)| {
        ParameterEstimate {
            name,
            unit: unit.to_owned(),
            estimate,
            stddev,
            at_bound,
            smallest_detectable: 5.0 * stddev,
        }
    });
    Some(Candidate {
        effect: id.to_owned(),
        delta_log_evidence: entering.gain,
        held_out_gain: None,
        share_of_excess: excess.share(entering.drop),
        swallowed_by_base: if is_hidden { 0.0 } else { beside.absorbed(&entering) },
        detectability: entering.drop.max(0.0),
        indistinguishable_from: Vec::new(),
        parameters: parameters.collect(),
    })
}
