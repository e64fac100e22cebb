//! The posterior over sets of explanations.

use std::collections::BTreeMap;

use crate::selection::unlisted::{Left, laws_beside};
use crate::selection::{Evaluated, Runs, Selection, log_prior};
use crate::signals::remains_of;
use crate::verdict::diagnosis::{FittedSet, ParameterOfSet, Termination, Unknown, Verdict};
use crate::{Outcome, Settings};

/// Deviations, over those of a certain line, from which an unexplained periodicity is one: beside no effect, and beside some, which leave lines.
const PERIODIC: [f64; 2] = [1.5, 2.0];
/// Share of the evidence of an effect above which its residual is another law, over that which its own formula may leave: twice its error.
const OF_OTHER_LAW: f64 = 4.0;

pub(crate) struct Posterior {
    /// Most probable first, then sets that are not admissible.
    pub sets: Vec<FittedSet>,
    /// Probability of all that hold something unmodelled.
    pub unknown: f64,
    pub nothing: f64,
    settings: Settings,
}

impl Posterior {
    /// Over sets of the catalogue's effects, and unlisted laws beside the best of them and alone, as it may only look like what is missing. No laws
    /// where a set leaves nothing: what is not there follows none.
    pub fn of(selection: &Selection<'_>, [best, base]: [Left<'_, '_>; 2], applied_n_m: f64) -> Outcome<Self> {
        let settings = &selection.runs.reference.settings;
        // Held-out runs are not asked for a law: they count for it as they do for the set that they like best.
        let admissible = selection.evaluated.iter().filter(|set| selection.is_admissible(set));
        let held_out = admissible.map(|set| selection.held_out_nats(set)).fold(0.0, f64::max);
        let law_beside = |set: &Evaluated, unknown: Unknown, gain: f64| {
            let gain = gain + held_out - selection.held_out_nats(set);
            let log_evidence = selection.log_posterior(set) + gain - log_prior(set.names(), settings);
            FittedSet { unmodelled: Some(unknown), log_evidence, ..of_set(selection, set, gain) }
        };
        let mut all: Vec<FittedSet> = Vec::new();
        // A law must explain more than the shape errors of the set's own formulas leave.
        let explained = best.set.log_evidence - base.set.log_evidence;
        let least = OF_OTHER_LAW * settings.misspecification * explained;
        let beside_base = (!best.set.names().is_empty()).then_some(base);
        for left in std::iter::once(best).chain(beside_base) {
            if remains_of(left.observed).significance() <= settings.noticed_stddevs {
                continue;
            }
            let is_large =
                |law: &Unknown| law.unit != "N m" || law.size > settings.background_share * applied_n_m;
            for (law, gain) in laws_beside(&selection.runs, left)? {
                if left.set.names().is_empty() || is_large(&law) && gain > least {
                    all.push(law_beside(left.set, law, gain));
                }
            }
        }
        // A periodicity that no effect explains: its peak as that of a normal variable, less the number of frequencies at which it might have been.
        let lines = best.lines;
        let factor = PERIODIC[usize::from(!best.set.names().is_empty())];
        if lines.strongest >= factor * settings.certain_stddevs {
            let unknown = Unknown { frequency_hz: lines.hz.first().copied(), ..Unknown::torque_in_time(0.0) };
            let log_evidence = 0.5 * lines.strongest.powi(2) - lines.frequencies.ln();
            all.push(law_beside(best.set, unknown, settings.unmodelled.ln() + log_evidence));
        }
        all.extend(selection.evaluated.iter().map(|set| fitted_set(selection, set, applied_n_m)));
        Ok(Self::new(all, settings))
    }

    /// Of sets with any probability, and with none those that are not admissible.
    pub fn new(mut sets: Vec<FittedSet>, settings: &Settings) -> Self {
        let admissible = || sets.iter().filter(|set| set.probability > 0.0);
        let most = admissible().map(|set| set.log_posterior).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = admissible().map(|set| (set.log_posterior - most).exp()).sum();
        for set in sets.iter_mut().filter(|set| set.probability > 0.0) {
            set.probability = (set.log_posterior - most).exp() / sum;
        }
        sets.sort_by(|a, b| {
            let of_log = || b.log_posterior.total_cmp(&a.log_posterior);
            b.probability.total_cmp(&a.probability).then_with(of_log)
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

    /// Sets that an answer names, most probable first; `with_unknown`: beside something unmodelled.
    pub fn named(&self, verdict: Verdict, with_unknown: bool) -> Vec<Vec<String>> {
        match verdict {
            Verdict::Named if with_unknown => vec![self.included()],
            Verdict::Named => self.contenders().into_iter().take(1).collect(),
            Verdict::Confounded if self.nothing < 0.5 => self.contenders(),
            _ => Vec::new(),
        }
    }

    /// The verdict; `could_see`: an effect of ordinary size would have shown.
    pub fn verdict(&self, could_see: bool) -> Verdict {
        let (sure, named) = (self.settings.sure, 1.0 - self.unknown - self.nothing);
        let is_sure = |set: &FittedSet| set.probability >= sure && set.unmodelled.is_none();
        if self.unknown > 0.5 {
            if self.included().is_empty() { Verdict::Unknown } else { Verdict::Named }
        } else if self.nothing >= sure && could_see {
            Verdict::NothingMissing
        } else if self.nothing > 1.0 - sure || named <= 0.5 {
            Verdict::NotEnoughInformation
        } else if self.sets.first().is_some_and(is_sure) {
            Verdict::Named
        } else {
            Verdict::Confounded
        }
    }
}

/// What is known of a set before its values, with something beside it that gains so much.
fn of_set(selection: &Selection<'_>, set: &Evaluated, gain: f64) -> FittedSet {
    FittedSet {
        effects: set.owned_names(),
        log_prior: log_prior(set.names(), &selection.runs.reference.settings),
        log_posterior: selection.log_posterior(set) + gain,
        probability: 1.0,
        ..FittedSet::default()
    }
}

fn fitted_set(selection: &Selection<'_>, set: &Evaluated, applied_n_m: f64) -> FittedSet {
    let Runs { held_out, reference, .. } = selection.runs;
    let parameters = set.columns.iter().enumerate().map(|(i, column)| {
        let found = set.parameter(reference, i);
        let (group, stddev) = (column.group.to_owned(), Some(found.stddev));
        ParameterOfSet { group, name: found.name, unit: found.unit, value: found.estimate, stddev }
    });
    // A slow random torque may be more than background.
    let torque_n_m = set.torque_n_m();
    let is_loud = torque_n_m > reference.settings.background_share * applied_n_m;
    FittedSet {
        unmodelled: is_loud.then(|| Unknown::torque_in_time(torque_n_m)),
        parameters: parameters.collect(),
        log_evidence: set.log_evidence,
        held_out_gain: (!held_out.is_empty()).then(|| selection.held_out_gain(set)),
        probability: f64::from(selection.is_admissible(set)),
        termination: Some(if set.fitted.stands { Termination::Converged } else { Termination::GivenUp }),
        seconds: set.seconds,
        ..of_set(selection, set, 0.0)
    }
}

#[cfg(test)]
mod tests;
