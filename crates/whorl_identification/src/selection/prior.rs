//! What a set of effects is worth before any data, and what it must do to be an explanation at all.

use whorl_dynamics::effects::find;

use crate::Settings;

/// Prior sizes of an effect that are tried, in units of its catalogue prior, each as likely. A ball bearing has a thousand times the
/// friction of an air bearing, and no file states the kind of bearing.
pub(crate) const SIZES: [f64; 6] = [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0];

/// Log prior odds of a set of effects against none.
pub(crate) fn log_prior<S: AsRef<str>>(set: &[S], settings: &Settings) -> f64 {
    let penalty = |id: &S| find(id.as_ref()).map_or(0.0, |effect| effect.prior_penalty_nats());
    set.iter().map(|id| (settings.present / (1.0 - settings.present)).ln() - penalty(id)).sum()
}

/// Minus the logarithm of a size's prior probability.
pub(crate) fn size_penalty_nats(size: f64, settings: &Settings) -> f64 {
    let rare = if size >= settings.unusual_size { settings.unusual_odds.ln() } else { 0.0 };
    (SIZES.len() as f64).ln() + rare
}
