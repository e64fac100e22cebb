//! What a set of effects is worth before any data, and what it must do to be an explanation at all.

use whorl_dynamics::effects::find;

/// Probability that makes an explanation the answer.
pub(crate) const SURE: f64 = 0.95;

/// Probability that a given effect is missing from a model, before any data: of some forty effects one in five models
/// lacks one.
const PRESENT: f64 = 0.005;

/// Log prior odds of a set of effects against none.
pub(crate) fn log_prior<S: AsRef<str>>(set: &[S]) -> f64 {
    let price = |id: &S| find(id.as_ref()).map_or(0.0, |effect| effect.price_nats());
    set.iter().map(|id| (PRESENT / (1.0 - PRESENT)).ln() - price(id)).sum()
}

/// Share of the evidence of a set that its own wrong formulas may leave to a further effect: no real friction, plenum or fan
/// follows its law to better than a tenth of its size, which leaves (10 %)^2. Errors in proportion to the signal are
/// integrated out; this is for shapes that are wrong.
const ECHO: f64 = 0.01;

/// What is left of an effect is another law's, or a random torque's, where it is a fifth of the effect's size, (20 %)^2 of its
/// evidence: twice what its own formula may leave.
pub(crate) const OTHER_LAW: f64 = 0.04;

/// A set with one member left out, each in turn.
pub(crate) fn smaller_sets(names: &[String]) -> impl Iterator<Item = Vec<String>> {
    let without = |left_out: &String| names.iter().filter(|id| *id != left_out).cloned().collect();
    names.iter().map(without)
}

/// Whether a set of this log evidence explains more than each smaller one by more than an echo of what that one explains;
/// `evidence` is that of other sets, if they were fitted.
pub(crate) fn is_no_echo(names: &[String], own: f64, evidence: impl Fn(&[String]) -> Option<f64>) -> bool {
    let Some(base) = evidence(&[]) else { return true };
    names.len() < 2
        || smaller_sets(names)
            .all(|rest| evidence(&rest).is_none_or(|rest| own - rest > ECHO * (rest - base)))
}
