//! Every set that was fitted, with what it was found to be worth.

use crate::Settings;
use crate::selection::{Evaluated, Selection};
use crate::verdict::diagnosis::{FittedSet, ParameterOfSet, Termination, Unknown};
use crate::verdict::posterior::Posterior;

/// All sets that were fitted, and laws that were compared beside them; most probable first, then those that are not admissible.
pub(super) fn traced(selection: &Selection<'_>, posterior: &Posterior, applied_n_m: f64) -> Vec<FittedSet> {
    let of_set = |set: &Evaluated| {
        let log_posterior = selection.log_posterior(set);
        let is_admissible = selection.is_admissible(set);
        let has_held_out = !selection.runs.held_out.is_empty();
        FittedSet {
            effects: set.names().iter().map(|id| (*id).to_owned()).collect(),
            unmodelled: unmodelled(set, &selection.runs.reference.settings, applied_n_m),
            parameters: parameters_of(selection, set),
            log_evidence: set.log_evidence,
            held_out_gain: has_held_out.then_some(set.held_out_log - selection.base().held_out_log),
            log_prior: selection.log_prior(set),
            log_posterior,
            probability: if is_admissible { posterior.probability(log_posterior) } else { 0.0 },
            termination: Some(if set.fitted.stands { Termination::Converged } else { Termination::GivenUp }),
            seconds: set.seconds,
        }
    };
    let mut all: Vec<FittedSet> = selection.evaluated.iter().map(of_set).collect();
    all.extend(posterior.laws.iter().map(|law| {
        let ids: Vec<&str> = law.effects.iter().map(String::as_str).collect();
        let log_prior = selection.set(&ids).map_or(0.0, |set| selection.log_prior(set));
        FittedSet {
            effects: law.effects.clone(),
            unmodelled: law.unknown.clone(),
            parameters: Vec::new(),
            log_evidence: law.log_posterior - log_prior,
            held_out_gain: None,
            log_prior,
            log_posterior: law.log_posterior,
            probability: law.probability,
            termination: None,
            seconds: 0.0,
        }
    }));
    let order = |set: &FittedSet| (set.probability, set.log_posterior);
    all.sort_by(|a, b| {
        let ((pa, la), (pb, lb)) = (order(a), order(b));
        pb.total_cmp(&pa).then(lb.total_cmp(&la))
    });
    all
}

/// Values of everything that was fitted.
fn parameters_of(selection: &Selection<'_>, set: &Evaluated) -> Vec<ParameterOfSet> {
    let reference = selection.runs.reference;
    let point = set.refit(reference).point(&set.fitted.at);
    let columns = set.columns.iter().enumerate();
    columns
        .map(|(i, column)| ParameterOfSet {
            group: column.group.to_owned(),
            name: column.name.clone(),
            unit: column.unit.to_owned(),
            value: reference.value_at(&point, column),
            stddev: Some(set.fitted.covariance[(i, i)].max(0.0).sqrt() * column.scale),
        })
        .collect()
}

/// A slow random torque that is more than background.
pub(super) fn unmodelled(set: &Evaluated, settings: &Settings, applied_n_m: f64) -> Option<Unknown> {
    let torque_n_m = set.torque_n_m();
    (torque_n_m > settings.background_share * applied_n_m).then(|| Unknown::torque_in_time(torque_n_m))
}
