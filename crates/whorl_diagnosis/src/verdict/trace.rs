//! Every set that was fitted, with what it was found to be worth.

use whorl_dynamics::effects::find;

use crate::diagnosis::{FittedSet, ParameterOfSet};
use crate::parameters::{Column, Point, Reference, Target};
use crate::search::Search;
use crate::search::prior::log_prior;
use crate::search::score::Converged;
use crate::verdict::posterior::Posterior;

impl Search<'_> {
    /// All sets that were fitted, and laws that were compared beside them; most probable first, then those that are not admissible.
    pub(crate) fn traced(&self, posterior: &Posterior) -> Vec<FittedSet> {
        let admissible: Vec<&Vec<String>> = self.admissible().map(|set| &set.names).collect();
        let of_set = |set: &Converged, is_admissible: bool| {
            let probability = if is_admissible { posterior.probability(set.log_posterior()) } else { 0.0 };
            self.traced_set(set, probability)
        };
        let mut all: Vec<FittedSet> =
            self.fitted.values().map(|set| of_set(set, admissible.contains(&&set.names))).collect();
        let is_known = |set: &&FittedSet| self.fitted.contains_key(&set.effects);
        all.extend(self.forgotten.iter().filter(|set| !is_known(set)).cloned());
        all.extend(posterior.laws.iter().map(|law| FittedSet {
            effects: law.effects.clone(),
            unmodelled: law.unknown.clone(),
            parameters: Vec::new(),
            log_evidence: law.log_posterior - log_prior(&law.effects, &self.options.settings),
            log_evidence_bins: None,
            log_evidence_samples: None,
            held_out_gain: None,
            log_prior: log_prior(&law.effects, &self.options.settings),
            log_posterior: law.log_posterior,
            probability: law.probability,
            judged_on_samples: false,
        }));
        let order = |set: &FittedSet| (set.probability, set.log_posterior);
        all.sort_by(|a, b| {
            let ((pa, la), (pb, lb)) = (order(a), order(b));
            pb.total_cmp(&pa).then(lb.total_cmp(&la))
        });
        all
    }

    /// A set that was fitted, of this probability.
    pub(crate) fn traced_set(&self, set: &Converged, probability: f64) -> FittedSet {
        let settings = &self.options.settings;
        let base = self.fitted.get(&Vec::new());
        let judged = set.judged.as_ref();
        let of_samples = judged.zip(base.and_then(|base| base.judged.as_ref()));
        let of_bins = base.map(|base| (set.score.held_log_likelihood, base.score.held_log_likelihood));
        let held = of_samples
            .map(|(set, base)| (set.likelihoods.held_out, base.likelihoods.held_out))
            .or(of_bins)
            .and_then(|(set, base)| Some(set? - base?));
        let reference = &self.problem.reference;
        let parameters = match judged {
            Some(judged) => {
                let refit = judged.fit.refit(reference);
                let fitted = &judged.fit.fitted;
                let stddev = |i: usize| fitted.covariance[(i, i)].max(0.0).sqrt();
                let columns: Vec<_> = refit.columns.iter().enumerate().map(|(i, c)| (c, stddev(i))).collect();
                parameters_of(reference, &refit.point(&fitted.at), &set.names, &columns)
            }
            None => {
                let stddevs = set.stddevs.iter().copied();
                let columns: Vec<_> = set.design.columns.iter().zip(stddevs).filter(|c| c.1 > 0.0).collect();
                parameters_of(reference, &set.point, &set.names, &columns)
            }
        };
        FittedSet {
            effects: set.names.clone(),
            unmodelled: self.large_background(set),
            parameters,
            log_evidence: set.score.worth(settings),
            log_evidence_bins: self.of_bins.get(&set.names).copied(),
            log_evidence_samples: judged.map(|judged| judged.likelihoods.training),
            held_out_gain: held,
            log_prior: log_prior(&set.names, settings),
            log_posterior: set.log_posterior(),
            probability,
            judged_on_samples: judged.is_some(),
        }
    }
}

/// Values at a point of the parameters that columns stand for, and of all others of these effects; deviations are in units of the columns.
fn parameters_of(
    reference: &Reference,
    point: &Point,
    effects: &[String],
    columns: &[(&Column, f64)],
) -> Vec<ParameterOfSet> {
    let mut all: Vec<ParameterOfSet> = Vec::new();
    for (column, stddev) in columns.iter().filter(|(column, _)| column.origin.is_none()) {
        let value = match column.target {
            Target::Moment(axis) => reference.inertia_b_kg_m2(point)[(axis, axis)],
            Target::Effect(effect) => {
                reference.values_at(point, effect).get(column.index).copied().unwrap_or(0.0)
            }
        };
        all.push(ParameterOfSet {
            group: column.group.to_owned(),
            name: column.name.clone(),
            unit: column.unit.to_owned(),
            value,
            stddev: Some(stddev * column.scale),
        });
    }
    for effect in effects.iter().filter_map(|id| find(id)) {
        let id = effect.info().id;
        // Those of an effect that entered by a direction of its own have no column each.
        if all.iter().any(|known| known.group == id) || !point.effects.contains_key(id) {
            continue;
        }
        let specs = effect.parameters(&reference.model);
        all.extend(specs.into_iter().zip(reference.values_at(point, effect)).map(|(spec, value)| {
            ParameterOfSet {
                group: id.to_owned(),
                name: spec.name,
                unit: spec.unit.to_owned(),
                value,
                stddev: None,
            }
        }));
    }
    all
}
