//! The posterior over sets of explanations.

use std::collections::BTreeMap;

use crate::Settings;
use crate::selection::{Evaluated, Selection};
use crate::verdict::diagnosis::{FittedSet, ParameterOfSet, Termination, Unknown, Verdict};

/// Every set and law with its probability, and what follows from these.
#[derive(Debug, Clone)]
pub(crate) struct Posterior {
    /// Most probable first, then sets that are not admissible.
    pub sets: Vec<FittedSet>,
    /// Probability of all that hold something unmodelled.
    pub unknown: f64,
    /// Probability that nothing is missing.
    pub nothing: f64,
    settings: Settings,
}

impl Posterior {
    /// Of sets with any probability, and with none those that are not admissible.
    pub fn new(mut sets: Vec<FittedSet>, settings: &Settings) -> Self {
        let admissible = || sets.iter().filter(|set| set.probability > 0.0);
        let most = admissible().map(|set| set.log_posterior).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = admissible().map(|set| (set.log_posterior - most).exp()).sum();
        for set in sets.iter_mut().filter(|set| set.probability > 0.0) {
            set.probability = (set.log_posterior - most).exp() / sum;
        }
        let order = |set: &FittedSet| (set.probability, set.log_posterior);
        sets.sort_by(|a, b| {
            let ((pa, la), (pb, lb)) = (order(a), order(b));
            pb.total_cmp(&pa).then(lb.total_cmp(&la))
        });
        let sum = |test: &dyn Fn(&FittedSet) -> bool| -> f64 {
            sets.iter().filter(|set| test(set)).map(|set| set.probability).sum()
        };
        let unknown = sum(&|set| set.unmodelled.is_some());
        let nothing = sum(&|set| set.unmodelled.is_none() && set.effects.is_empty());
        Self { sets, unknown, nothing, settings: *settings }
    }

    /// Explanations worth mentioning, most probable first.
    pub fn likely(&self) -> impl Iterator<Item = &FittedSet> {
        self.sets.iter().take_while(|set| set.probability > self.settings.worth_mentioning)
    }

    /// The named sets, most probable first, until all explanations so far have the probability `sure` together.
    pub fn contenders(&self) -> Vec<Vec<String>> {
        let mut sum = 0.0;
        let needed = self.likely().take_while(|set| {
            let is_needed = sum < self.settings.sure;
            sum += set.probability;
            is_needed
        });
        let named = needed.filter(|set| set.unmodelled.is_none() && !set.effects.is_empty());
        named.map(|set| set.effects.clone()).collect()
    }

    /// Effects that are in the explanations with a probability that makes an answer, whatever else these hold.
    pub fn included(&self) -> Vec<String> {
        let mut sums: BTreeMap<&String, f64> = BTreeMap::new();
        for set in self.likely() {
            set.effects.iter().for_each(|id| *sums.entry(id).or_default() += set.probability);
        }
        sums.into_iter().filter(|(_, sum)| *sum >= self.settings.sure).map(|(id, _)| id.clone()).collect()
    }

    /// The verdict; `could_see`: an effect of ordinary size would have shown.
    pub fn verdict(&self, could_see: bool) -> Verdict {
        let sure = self.settings.sure;
        if self.unknown > 0.5 {
            return if self.included().is_empty() { Verdict::Unknown } else { Verdict::Named };
        }
        let named = 1.0 - self.unknown - self.nothing;
        if self.nothing >= sure && could_see {
            return Verdict::NothingMissing;
        }
        if self.nothing > 1.0 - sure || named <= 0.5 {
            return Verdict::NotEnoughInformation;
        }
        match self.sets.first() {
            Some(first) if first.probability >= sure && first.unmodelled.is_none() => Verdict::Named,
            _ => Verdict::Confounded,
        }
    }
}

/// A set that was fitted, with what it was found to be worth.
pub(super) fn fitted_set(selection: &Selection<'_>, set: &Evaluated, applied_n_m: f64) -> FittedSet {
    let (reference, settings) = (selection.runs.reference, &selection.runs.reference.settings);
    let parameters = set.columns.iter().enumerate().map(|(i, column)| {
        let found = set.parameter(reference, i);
        let (group, stddev) = (column.group.to_owned(), Some(found.stddev));
        ParameterOfSet { group, name: found.name, unit: found.unit, value: found.estimate, stddev }
    });
    let has_held_out = !selection.runs.held_out.is_empty();
    // A slow random torque may be more than background.
    let torque_n_m = set.torque_n_m();
    let is_loud = torque_n_m > settings.background_share * applied_n_m;
    FittedSet {
        effects: set.owned_names(),
        unmodelled: is_loud.then(|| Unknown::torque_in_time(torque_n_m)),
        parameters: parameters.collect(),
        log_evidence: set.log_evidence,
        held_out_gain: has_held_out.then_some(set.held_out_log - selection.base().held_out_log),
        log_prior: selection.log_prior(set),
        log_posterior: selection.log_posterior(set),
        probability: f64::from(selection.is_admissible(set)),
        termination: Some(if set.fitted.stands { Termination::Converged } else { Termination::GivenUp }),
        seconds: set.seconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighted(effects: &[&str], probability: f64) -> FittedSet {
        FittedSet {
            effects: effects.iter().map(|e| (*e).to_owned()).collect(),
            log_posterior: probability.ln(),
            probability: 1.0,
            ..FittedSet::default()
        }
    }

    #[test]
    fn a_verdict_is_read_off_the_probabilities() {
        let verdict = |list: &[(&[&str], f64)]| {
            let all = list.iter().map(|(set, p)| weighted(set, *p)).collect();
            Posterior::new(all, &Settings::default()).verdict(true)
        };
        assert_eq!(verdict(&[(&["a"], 0.97), (&["b"], 0.02), (&[], 0.01)]), Verdict::Named);
        assert_eq!(verdict(&[(&["a"], 0.70), (&["b"], 0.29), (&[], 0.01)]), Verdict::Confounded);
        assert_eq!(verdict(&[(&["a"], 0.20), (&[], 0.80)]), Verdict::NotEnoughInformation);
        assert_eq!(verdict(&[(&["a"], 0.03), (&[], 0.97)]), Verdict::NothingMissing);
        let posterior = Posterior::new(
            vec![weighted(&["b"], 0.3), weighted(&["a"], 0.6), weighted(&["c"], 0.1)],
            &Settings::default(),
        );
        assert_eq!(posterior.contenders(), [["a"], ["b"], ["c"]]);
        assert!((posterior.sets[0].probability - 0.6).abs() < 1e-12);
        // Something unknown beside a friction that is there in any case is said with it, not in its place.
        let with = |effects: &[&str], probability: f64| FittedSet {
            unmodelled: Some(Unknown::torque_in_time(1.0)),
            ..weighted(effects, probability)
        };
        let beside = Posterior::new(vec![with(&["a"], 0.9), weighted(&["a"], 0.1)], &Settings::default());
        assert_eq!((beside.verdict(true), beside.included()), (Verdict::Named, vec!["a".to_owned()]));
        let instead = Posterior::new(vec![with(&["a"], 0.5), with(&[], 0.5)], &Settings::default());
        assert_eq!(instead.verdict(true), Verdict::Unknown);
    }
}
