//! The table of candidates: a row for each effect of the answer, and for each that was compared beside it.

use whorl_prediction::Followed;

use crate::selection::beside::{Beside, Entering};
use crate::selection::{Evaluated, Selection};
use crate::verdict::diagnosis::{Candidate, ParameterEstimate};

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
    let (reference, followed) = (selection.runs.reference, &best.fitted.followed);
    // Of the drop of the misfit that the answer brings, and of what it leaves: see [`Candidate::share_of_excess`].
    let left: f64 = followed.iter().map(|run| 2.0 * run.gain_nats.max(0.0)).sum();
    let numbers: usize = followed.iter().map(|run| run.undisturbed_likelihood.numbers).sum();
    // Where nothing is named, what is within chance is no excess.
    let noticed = reference.settings.noticed_stddevs;
    let chance = if best.names().is_empty() { noticed * (2.0 * numbers as f64).sqrt() } else { 1.0 };
    let excess = (drop_over(best, selection.base()) + left).max(chance);
    // An effect with what it brings in log evidence and in the misfit, and to held-out runs.
    let row =
        |id: &str, log_evidence: f64, drop: f64, held_out: Option<f64>, swallowed, parameters| Candidate {
            held_out_gain: held_out.filter(|_| !selection.runs.held_out.is_empty()),
            share_of_excess: (drop / excess.max(drop)).clamp(0.0, 1.0),
            swallowed_by_base: swallowed,
            ..Candidate::seen(id, drop.max(0.0), log_evidence, parameters)
        };
    let parameters = |set: &Evaluated, id: &str| -> Vec<ParameterEstimate> {
        set.columns_of(id).into_iter().map(|i| set.parameter(reference, i)).collect()
    };
    let member = |id: &&'static str| {
        let names: Vec<&str> = best.names().iter().copied().filter(|other| other != id).collect();
        let smaller = selection.set(&names);
        let (log_evidence, drop) = smaller
            .map(|smaller| (best.log_evidence - smaller.log_evidence, drop_over(best, smaller)))
            .unwrap_or_else(|| best.brought_beside(&names).unwrap_or_default());
        let held_out = smaller.map(|smaller| best.held_out_log - smaller.held_out_log);
        let absorbed = |beside: &Beside<'_>| beside.absorbed(&best.columns_of(id), |i| best.amplitude(i));
        row(id, log_evidence, drop, held_out, beside.map_or(0.0, absorbed), parameters(best, id))
    };
    // As it was fitted with the best set, else as the samples predict it.
    let other = |beside: &Beside<'_>, id: &'static str| {
        let mut names: Vec<&str> = best.names().iter().copied().chain([id]).collect();
        names.sort_unstable();
        let entering = beside.entering(id);
        let step = |e: &Entering, i: usize| {
            e.estimate.of(i) + beside.counted_from(i) - best.fitted.at.get(i).unwrap_or(&0.0)
        };
        let absorbed = |e: &Entering| beside.absorbed(&e.columns, |i| step(e, i));
        if let Some(larger) = selection.set(&names) {
            let log_evidence = larger.log_evidence - best.log_evidence;
            let held_out = Some(larger.held_out_log - best.held_out_log);
            let drop = drop_over(larger, best) - drop_over(best, best);
            let absorbed = entering.as_ref().map_or(0.0, absorbed);
            return Some(row(id, log_evidence, drop, held_out, absorbed, parameters(larger, id)));
        }
        let entering = entering?;
        let absorbed = if reference.is_hidden(id) { 0.0 } else { absorbed(&entering) };
        Some(row(id, entering.gain, entering.drop, None, absorbed, beside.values(&entering)))
    };
    let of_beside = beside.iter().flat_map(|beside| beside.effects().filter_map(|id| other(beside, id)));
    let mut others: Vec<Candidate> = of_beside.collect();
    others.sort_by(|a, b| b.delta_log_evidence.total_cmp(&a.delta_log_evidence));
    best.names().iter().map(member).chain(others).collect()
}
