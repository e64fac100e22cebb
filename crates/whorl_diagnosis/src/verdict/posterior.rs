//! What is believed: the posterior over sets of explanations.

use whorl_dynamics::effects::find;

use crate::search::converge::{Standing, Standings};
use crate::verdict::diagnosis::{Unknown, Verdict};

/// Probability that a given effect is missing from a model, before any data: of some forty effects one in five models
/// lacks one.
const PRESENT: f64 = 0.005;

/// Log prior odds of a set of effects against none.
pub(crate) fn log_prior<S: AsRef<str>>(set: &[S]) -> f64 {
    let price = |id: &S| find(id.as_ref()).map_or(0.0, |effect| effect.price_nats());
    set.iter().map(|id| (PRESENT / (1.0 - PRESENT)).ln() - price(id)).sum()
}

/// Whether a set explains the training data better than the base model, and held-out data not worse where there are any:
/// what does not let the error fall explains nothing. What held-out data say of a faint effect scatters: a log likelihood
/// ratio has a variance of twice its mean, which is at most what the training data gained.
pub(crate) fn explains_more(set: &Standing, base: &Standing) -> bool {
    let held = match (set.held_log_likelihood, base.held_log_likelihood) {
        (Some(set), Some(base)) => set - base,
        _ => 0.0,
    };
    let gain = set.log_likelihood - base.log_likelihood;
    gain > 0.0 && held > -(2.0 * gain).sqrt()
}

/// Share of the evidence of a set that its own wrong formulas may leave to a further effect: no real friction, plenum or fan
/// follows its law to better than a tenth of its size, which leaves (10 %)^2. Errors in proportion to the signal are
/// integrated out; this is for shapes that are wrong.
const ECHO: f64 = 0.01;

/// Whether a set explains more than each smaller one by more than an echo of what that one explains.
pub(crate) fn is_no_echo(names: &[String], standings: &Standings) -> bool {
    let evidence = |names: &[String]| standings.get(names).map(|s| s.log_evidence);
    let (Some(own), Some(base)) = (evidence(names), evidence(&[])) else { return true };
    names.len() < 2
        || names.iter().all(|left_out| {
            let rest: Vec<String> = names.iter().filter(|id| *id != left_out).cloned().collect();
            evidence(&rest).is_none_or(|rest| own - rest > ECHO * (rest - base))
        })
}

/// One explanation of the data and its weight.
#[derive(Debug, Clone)]
pub(crate) struct Weighted {
    pub effects: Vec<String>,
    /// What it holds that has no name.
    pub unknown: Option<Unknown>,
    /// Log posterior, up to a constant.
    pub log_posterior: f64,
    pub probability: f64,
}

/// Probability that makes an explanation the answer.
pub(crate) const SURE: f64 = 0.95;

/// Explanations below this are not mentioned.
const WORTH_MENTIONING: f64 = 1e-3;

/// Explanations with their probabilities, most probable first. Of like ones the best counts: they are one explanation,
/// found in several ways.
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
pub(crate) struct Belief {
    /// Explanations worth mentioning, most probable first.
    pub all: Vec<Weighted>,
    /// Probability of all that hold something without a name.
    pub unknown: f64,
    /// Probability that nothing is missing.
    pub nothing: f64,
}

impl Belief {
    pub fn new(all: Vec<Weighted>) -> Self {
        let mut all = normalised(all);
        let sum = |test: &dyn Fn(&Weighted) -> bool| -> f64 {
            all.iter().filter(|w| test(w)).map(|w| w.probability).sum()
        };
        let unknown = sum(&|w| w.unknown.is_some());
        let nothing = sum(&|w| w.unknown.is_none() && w.effects.is_empty());
        all.retain(|w| w.probability > WORTH_MENTIONING);
        Self { all, unknown, nothing }
    }

    /// The named sets, most probable first, that together with all else that is more probable make up what is sure.
    pub fn contenders(&self) -> Vec<Vec<String>> {
        let mut sum = 0.0;
        let mut sets: Vec<Vec<String>> = Vec::new();
        for one in &self.all {
            if one.unknown.is_none() && !one.effects.is_empty() {
                sets.push(one.effects.clone());
            }
            sum += one.probability;
            if sum >= SURE {
                break;
            }
        }
        sets
    }

    /// The verdict; `could_see`: an effect of ordinary size would have shown.
    pub fn verdict(&self, could_see: bool) -> Verdict {
        if self.unknown > 0.5 {
            return Verdict::Unknown;
        }
        let named = 1.0 - self.unknown - self.nothing;
        if self.nothing >= SURE && could_see {
            return Verdict::NothingMissing;
        }
        if self.nothing > 1.0 - SURE || named <= 0.5 {
            return Verdict::NotEnoughInformation;
        }
        match self.all.first() {
            Some(first) if first.probability >= SURE && first.unknown.is_none() => Verdict::Named,
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
            log_posterior: probability.ln(),
            probability: 0.0,
        }
    }

    #[test]
    fn what_lets_the_error_stand_explains_nothing() {
        let standing = |log_likelihood: f64, held: Option<f64>| Standing {
            log_evidence: log_likelihood,
            training_evidence: 0.0,
            log_likelihood,
            held_log_likelihood: held,
            misfit: 0.0,
            promise: 0.0,
            relative_error: 0.0,
            nuisance: crate::evidence::nuisance::Nuisance::default(),
        };
        let base = standing(-10.0, Some(-5.0));
        assert!(explains_more(&standing(-2.0, Some(-4.0)), &base));
        assert!(explains_more(&standing(-2.0, Some(-5.5)), &base));
        assert!(!explains_more(&standing(-2.0, Some(-9.5)), &base));
        assert!(!explains_more(&standing(-11.0, Some(-4.0)), &base));
        assert!(explains_more(&standing(-2.0, None), &standing(-10.0, None)));
    }

    #[test]
    fn a_verdict_is_read_off_the_probabilities() {
        let verdict = |list: &[(&[&str], f64)]| {
            Belief::new(list.iter().map(|(set, p)| weighted(set, *p)).collect()).verdict(true)
        };
        assert_eq!(verdict(&[(&["a"], 0.97), (&["b"], 0.02), (&[], 0.01)]), Verdict::Named);
        assert_eq!(verdict(&[(&["a"], 0.70), (&["b"], 0.29), (&[], 0.01)]), Verdict::Confounded);
        assert_eq!(verdict(&[(&["a"], 0.20), (&[], 0.80)]), Verdict::NotEnoughInformation);
        assert_eq!(verdict(&[(&["a"], 0.03), (&[], 0.97)]), Verdict::NothingMissing);
        let belief = Belief::new(vec![weighted(&["b"], 0.3), weighted(&["a"], 0.6), weighted(&["c"], 0.1)]);
        assert_eq!(belief.contenders(), [["a"], ["b"], ["c"]]);
        assert!((belief.all[0].probability - 0.6).abs() < 1e-12);
    }
}
