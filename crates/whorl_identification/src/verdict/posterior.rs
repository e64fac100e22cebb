//! The posterior over sets of explanations.

use crate::Settings;
use crate::verdict::diagnosis::{Unknown, Verdict};

/// One explanation of the data and its weight.
#[derive(Debug, Clone)]
pub(crate) struct Weighted {
    pub effects: Vec<String>,
    /// What it holds that is unmodelled.
    pub unknown: Option<Unknown>,
    /// A law beside a set, not a set that was fitted.
    pub is_law: bool,
    /// Log posterior, up to a constant.
    pub log_posterior: f64,
    pub probability: f64,
}

/// Explanations with their probabilities, most probable first.
pub(crate) fn normalised(mut all: Vec<Weighted>) -> Vec<Weighted> {
    all.sort_by(|a, b| b.log_posterior.total_cmp(&a.log_posterior));
    let most = all.first().map_or(0.0, |w| w.log_posterior);
    let sum: f64 = all.iter().map(|w| (w.log_posterior - most).exp()).sum();
    for one in &mut all {
        one.probability = (one.log_posterior - most).exp() / sum;
    }
    all
}

/// What follows from the probabilities.
#[derive(Debug, Clone)]
pub(crate) struct Posterior {
    /// Explanations worth mentioning, most probable first.
    pub all: Vec<Weighted>,
    /// Probability of all that hold something unmodelled.
    pub unknown: f64,
    /// Probability that nothing is missing.
    pub nothing: f64,
    /// Probability that makes an answer.
    sure: f64,
    /// Logarithm of the sum of all weights.
    log_sum: f64,
    /// Laws beside sets, likely or not, most probable first.
    pub laws: Vec<Weighted>,
}

impl Posterior {
    pub fn new(all: Vec<Weighted>, settings: &Settings) -> Self {
        let mut all = normalised(all);
        let sum = |test: &dyn Fn(&Weighted) -> bool| -> f64 {
            all.iter().filter(|w| test(w)).map(|w| w.probability).sum()
        };
        let unknown = sum(&|w| w.unknown.is_some());
        let nothing = sum(&|w| w.unknown.is_none() && w.effects.is_empty());
        let log_sum = all.first().map_or(0.0, |most| most.log_posterior - most.probability.ln());
        let laws = all.iter().filter(|w| w.is_law).cloned().collect();
        all.retain(|w| w.probability > settings.worth_mentioning);
        Self { all, unknown, nothing, sure: settings.sure, log_sum, laws }
    }

    /// Probability of an explanation with this log posterior.
    pub fn probability(&self, log_posterior: f64) -> f64 {
        (log_posterior - self.log_sum).exp()
    }

    /// The named sets, most probable first, until all explanations so far have the probability `sure` together.
    pub fn contenders(&self) -> Vec<Vec<String>> {
        let mut sum = 0.0;
        let mut sets: Vec<Vec<String>> = Vec::new();
        for one in &self.all {
            if one.unknown.is_none() && !one.effects.is_empty() {
                sets.push(one.effects.clone());
            }
            sum += one.probability;
            if sum >= self.sure {
                break;
            }
        }
        sets
    }

    /// Effects that are in the explanations with a probability that makes an answer, whatever else these hold.
    pub fn included(&self) -> Vec<String> {
        let mut sums: std::collections::BTreeMap<&String, f64> = std::collections::BTreeMap::new();
        for one in &self.all {
            for id in &one.effects {
                *sums.entry(id).or_default() += one.probability;
            }
        }
        sums.into_iter().filter(|(_, sum)| *sum >= self.sure).map(|(id, _)| id.clone()).collect()
    }

    /// The verdict; `could_see`: an effect of ordinary size would have shown.
    pub fn verdict(&self, could_see: bool) -> Verdict {
        if self.unknown > 0.5 {
            return if self.included().is_empty() { Verdict::Unknown } else { Verdict::Named };
        }
        let named = 1.0 - self.unknown - self.nothing;
        if self.nothing >= self.sure && could_see {
            return Verdict::NothingMissing;
        }
        if self.nothing > 1.0 - self.sure || named <= 0.5 {
            return Verdict::NotEnoughInformation;
        }
        match self.all.first() {
            Some(first) if first.probability >= self.sure && first.unknown.is_none() => Verdict::Named,
            _ => Verdict::Confounded,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighted(effects: &[&str], probability: f64) -> Weighted {
        Weighted {
            effects: effects.iter().map(|e| (*e).to_owned()).collect(),
            unknown: None,
            is_law: false,
            log_posterior: probability.ln(),
            probability: 0.0,
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
        assert!((posterior.all[0].probability - 0.6).abs() < 1e-12);
        // Something unknown beside a friction that is there in any case is said with it, not in its place.
        let with = |effects: &[&str], probability: f64| Weighted {
            unknown: Some(Unknown::torque_in_time(1.0)),
            ..weighted(effects, probability)
        };
        let beside = Posterior::new(vec![with(&["a"], 0.9), weighted(&["a"], 0.1)], &Settings::default());
        assert_eq!((beside.verdict(true), beside.included()), (Verdict::Named, vec!["a".to_owned()]));
        let instead = Posterior::new(vec![with(&["a"], 0.5), with(&[], 0.5)], &Settings::default());
        assert_eq!(instead.verdict(true), Verdict::Unknown);
    }
}
