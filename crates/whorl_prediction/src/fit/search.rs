//! Values and levels of noise by turns.

use nalgebra::DMatrix;

use super::ascent::End;
use super::problem::{Iterate, Problem, runs_of};
use crate::fitted::LARGEST_MISFIT;
use crate::levels::{Followed, follow, followed_from};
use crate::noise::Noise;
use crate::refusal::PredictionError;

/// Where a search ended.
pub(super) struct Settled {
    pub iterate: Iterate,
    /// The information on the parameters there, if it is known.
    pub information: Option<DMatrix<f64>>,
    pub stands: bool,
    /// The predicted gain was too small to become as likely as it should.
    pub is_hopeless: bool,
}

impl Problem<'_> {
    /// Each recording with the levels and the start that it shows with the model there; where there are disturbances, what the model without them
    /// makes of it may be that of the values before.
    fn followed(&self, at: &[f64], before: Option<&[Followed]>) -> Result<Iterate, PredictionError> {
        let followed = self.each(at, |case, run| {
            let stated = Noise::stated(case)?;
            let before = before.and_then(|before| before.get(run));
            Ok(before
                .map_or_else(|| follow(case, &stated), |before| followed_from(case, &stated, before, true)))
        });
        Ok(self.iterate(at, followed?))
    }

    /// The likeliest of these values with the levels that it shows. Those of a rival are taken, if there is one with the same states, while these are
    /// compared: only the likeliest then needs its own, if it is not as likely as the rival, which it may be itself.
    pub fn begun(&self, starts: &[Vec<f64>], rival: &[Followed]) -> Result<Iterate, PredictionError> {
        let runs = runs_of(rival);
        let is_of = |at: &Vec<f64>| {
            let of = self.each(at, |case, run| Ok(runs.get(run).is_some_and(|(_, start)| start.is_of(case))));
            of.is_ok_and(|of| of.into_iter().all(|is_of| is_of))
        };
        if rival.is_empty() || !starts.iter().any(is_of) {
            let mut best: Option<Iterate> = None;
            for at in starts {
                let here = match self.followed(at, best.as_ref().map(|best| &best.followed[..])) {
                    Err(PredictionError::NoModel) => continue,
                    other => other?,
                };
                if best.as_ref().is_none_or(|best| here.log_posterior > best.log_posterior) {
                    best = Some(here);
                }
            }
            return best.ok_or(PredictionError::NoModel);
        }
        let mut best: Option<(f64, &Vec<f64>)> = None;
        for at in starts {
            let log = match self.passes_near(at, &runs, &[]) {
                Err(PredictionError::NoModel) => continue,
                passes => self.log(at, &passes?),
            };
            if best.is_none_or(|(most, _)| log > most) {
                best = Some((log, at));
            }
        }
        let (log, at) = best.ok_or(PredictionError::NoModel)?;
        let as_rival = self.iterate(at, rival.to_vec());
        let is_rival = (log - as_rival.log_posterior).abs() < self.settings.fit_round_nats;
        if is_rival { Ok(as_rival) } else { self.followed(at, Some(rival)) }
    }

    /// Values and levels by turns, until both stand, or nothing likelier than `least` is in sight.
    pub fn settled(&self, begun: Iterate, least: f64) -> Result<Settled, PredictionError> {
        let settings = self.settings;
        let stands = self.parameters.is_empty();
        let mut best = Settled { iterate: begun, information: None, stands, is_hopeless: false };
        let mut levels = best.iterate.clone();
        let mut known = None;
        for round in 0..settings.fit_rounds {
            if best.stands {
                break;
            }
            let (place, end, information) = self.ascent(&levels, known.take(), round == 0, least)?;
            let is_top = end == End::Top;
            best.is_hopeless = end == End::Hopeless;
            if best.is_hopeless || place.at == levels.at {
                if is_top && round == 0 {
                    // The predicted gain was too small for a rough look.
                    known = Some(place.passes);
                    continue;
                }
                // Levels that were found here are found again.
                best.information = (place.at == best.iterate.at).then_some(information);
                best.stands = is_top && best.information.is_some();
                break;
            }
            let with_old_levels = self.log(&place.at, &place.passes);
            for ((run, (_, start)), pass) in levels.followed.iter_mut().zip(place.runs).zip(place.passes) {
                (run.fitted.start, run.fitted.covariance) = (start, pass.sums.own);
            }
            let Ok(next) = self.followed(&place.at, Some(&levels.followed)) else { break };
            let is_disturbed = |run: &Followed| run.noise.disturbance.is_some();
            let are_alike =
                levels.followed.iter().map(is_disturbed).eq(next.followed.iter().map(is_disturbed));
            let log_before = std::mem::replace(&mut levels, next).log_posterior;
            let same = are_alike && levels.log_posterior - with_old_levels <= settings.fit_round_nats;
            if levels.log_posterior > best.iterate.log_posterior {
                best.iterate = levels.clone();
                // Levels that stand make the same of the parameters.
                best.information = same.then_some(information);
            }
            let gains = levels.log_posterior - log_before > settings.fit_round_nats;
            best.stands = same && is_top || !gains;
        }
        Ok(best)
    }

    /// The same values without disturbances, where there are any and the model is close to the recordings without them.
    pub fn without_disturbance(&self, iterate: &Iterate) -> Option<Iterate> {
        let runs = &iterate.followed;
        let is_close = |run: &Followed| run.undisturbed_likelihood.misfit() < LARGEST_MISFIT;
        let any = runs.iter().any(|run| run.noise.disturbance.is_some());
        (any && runs.iter().all(is_close))
            .then(|| self.iterate(&iterate.at, runs.iter().map(Followed::without_disturbance).collect()))
    }
}
