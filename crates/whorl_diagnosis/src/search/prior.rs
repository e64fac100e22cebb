//! What a set of effects is worth before any data, and what it must do to be an explanation at all.

use whorl_dynamics::effects::find;

use crate::Settings;

/// Log prior odds of a set of effects against none.
pub(crate) fn log_prior<S: AsRef<str>>(set: &[S], settings: &Settings) -> f64 {
    let penalty = |id: &S| find(id.as_ref()).map_or(0.0, |effect| effect.prior_penalty_nats());
    set.iter().map(|id| (settings.present / (1.0 - settings.present)).ln() - penalty(id)).sum()
}

/// Share of the evidence of an effect above which its residual is taken for another law or a random torque: that of twice the relative
/// error that its own formula may have.
pub(crate) fn of_other_law(settings: &Settings) -> f64 {
    4.0 * settings.misspecification
}

/// A set with one term left out, each in turn.
pub(crate) fn smaller_sets(names: &[String]) -> impl Iterator<Item = Vec<String>> {
    let without = |left_out: &String| names.iter().filter(|id| *id != left_out).cloned().collect();
    names.iter().map(without)
}

/// Whether the gain of a set over each smaller one exceeds the misspecification leakage of the smaller one;
/// `evidence` is that of other sets, if they were fitted.
pub(crate) fn is_no_leakage(
    names: &[String],
    own: f64,
    settings: &Settings,
    evidence: impl Fn(&[String]) -> Option<f64>,
) -> bool {
    let Some(base) = evidence(&[]) else { return true };
    names.len() < 2
        || smaller_sets(names).all(|smaller| {
            evidence(&smaller)
                .is_none_or(|smaller| own - smaller > settings.misspecification * (smaller - base))
        })
}
