//! Inertial units with a latency longer than pulses.
//!
//! Readings are compared with the motion at their stamps, extrapolated by the latency. The longer the latency, the less
//! the first regressions show of it, and the more a delay of the valves looks the same. Once a latency is a good
//! explanation, the recordings are divided into bins anew with stamps set back by it, and searched again.

use whorl_dynamics::effects::find;

use crate::Settings;
use crate::search::Search;
use crate::search::score::Score;

/// Difference from the latency used for the bins above which new bins are worth it \[s\].
const FAR_S: f64 = 2e-3;

/// Whether a set holds an effect that delays the inertial unit.
fn holds_latency(names: &[String]) -> bool {
    names.iter().any(|id| find(id).is_some_and(|effect| effect.imu_latency_s(&[]).is_some()))
}

/// A set with an inertial latency.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SetWithLatency {
    terms: usize,
    log_evidence: f64,
    extra_latency_s: f64,
}

/// What a search found of the inertial unit's latency.
#[derive(Debug, Clone, Default)]
pub(crate) struct FoundLatency {
    /// Latency beyond the model's sensors where a set that holds it fits best \[s\].
    extra_latency_s: Option<f64>,
    /// Log evidence of the best such set, of the best set of all, and of nothing missing.
    with: f64,
    best: f64,
    base: f64,
    /// Log evidence by which that set leads before all that do not hold a latency.
    lead: f64,
    /// The best set of all holds it.
    holds_latency: bool,
}

impl FoundLatency {
    pub fn of(search: &Search<'_>) -> Self {
        let evidence = |score: Option<Score>| score.map(|s| s.log_evidence);
        let base = evidence(search.score(&search.base)).unwrap_or(search.base.log_evidence);
        let best = evidence(search.score(&search.best)).unwrap_or(search.best.log_evidence);
        let others = search.fitted.values().filter(|c| !holds_latency(&c.names));
        let rival = others.map(|c| c.score.log_evidence).fold(base, f64::max);
        let holds_latency = holds_latency(&search.best.names(&search.design));
        let with = if holds_latency { best } else { search.latency.map_or(base, |set| set.log_evidence) };
        let extra_latency_s = search.latency.map(|set| set.extra_latency_s);
        Self { extra_latency_s, with, best, base, lead: with - rival, holds_latency }
    }

    /// The latency, if it is a good explanation and far from that used for the bins.
    pub fn worth_new_bins(&self, laid_out_s: f64, settings: &Settings) -> Option<f64> {
        let is_good = self.with - self.base > settings.doubt_nats
            && self.best - self.with < settings.latency_near_share * (self.best - self.base).max(0.0);
        self.extra_latency_s.filter(|extra_latency_s| is_good && (extra_latency_s - laid_out_s).abs() > FAR_S)
    }

    /// Whether the latency is better than all else in the mean over bins made with it, which these are, and bins made
    /// without it: each choice of bins favours its own, alike.
    pub fn explains_more_than_others(&self, without: &Self, settings: &Settings) -> bool {
        self.holds_latency && self.lead + without.lead > 2.0 * settings.doubt_nats
    }
}

impl Search<'_> {
    /// Keeps the latency of the best set that holds one: of the smallest set, for a delay of valves beside it takes
    /// some of it away.
    pub(crate) fn watch_latency(
        &mut self,
        names: &[String],
        log_evidence: f64,
        point: &crate::parameters::Point,
    ) {
        let is_better = |known: &SetWithLatency| {
            names.len() < known.terms || (names.len() == known.terms && log_evidence > known.log_evidence)
        };
        if holds_latency(names) && self.latency.as_ref().is_none_or(is_better) {
            let extra_latency_s = self.problem.reference.extra_latency_at_s(point);
            self.latency = Some(SetWithLatency { terms: names.len(), log_evidence, extra_latency_s });
        }
    }
}
