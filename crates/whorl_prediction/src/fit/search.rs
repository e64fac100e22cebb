//! Values and levels of noise by turns.

use nalgebra::{Cholesky, DMatrix};

use super::Fitted;
use super::ascent::{Ascent, End};
use super::problem::{Iterate, Problem, runs_of};
use crate::error::PredictionError;
use crate::fitted::LARGEST_MISFIT;
use crate::levels::Followed;

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
    /// The likeliest of these values with the levels that it shows.
    pub fn begun(&self, starts: &[Vec<f64>]) -> Result<Iterate, PredictionError> {
        let mut best: Option<Iterate> = None;
        for at in starts {
            let followed = match self.followed(at, best.as_ref().map(|best| &best.followed[..])) {
                Err(PredictionError::NoModel) => continue,
                other => other?,
            };
            let here = Iterate { log_posterior: self.log_posterior(at, &followed), at: at.clone(), followed };
            if best.as_ref().is_none_or(|best| here.log_posterior > best.log_posterior) {
                best = Some(here);
            }
        }
        best.ok_or(PredictionError::NoModel)
    }

    /// The same with the levels of a rival, of which only the likeliest needs its own: if it is not as likely as the rival, which it may
    /// be itself.
    pub fn begun_beside(&self, starts: &[Vec<f64>], rival: &[Followed]) -> Result<Iterate, PredictionError> {
        let runs = runs_of(rival);
        let mut best: Option<(f64, &Vec<f64>)> = None;
        if !starts.iter().any(|at| self.are_of(at, &runs)) {
            return self.begun(starts);
        }
        for at in starts {
            let log = match self.passes_without_columns(at, &runs) {
                Err(PredictionError::NoModel) => continue,
                passes => passes?.log_likelihood(),
            };
            let here = log + self.log_prior(at);
            if best.is_none_or(|(most, _)| here > most) {
                best = Some((here, at));
            }
        }
        let (log_posterior, at) = best.ok_or(PredictionError::NoModel)?;
        let of_rival = self.log_posterior(at, rival);
        let followed = if (log_posterior - of_rival).abs() < self.settings.fit_round_nats {
            rival.to_vec()
        } else {
            self.followed(at, Some(rival))?
        };
        Ok(Iterate { log_posterior: self.log_posterior(at, &followed), at: at.clone(), followed })
    }

    /// Values and levels by turns, until both stand, or nothing likelier than `least` is in sight.
    pub fn settled(&self, begun: Iterate, least: f64) -> Result<Settled, PredictionError> {
        let settings = self.settings;
        let nothing_varies = self.parameters.is_empty();
        let mut best =
            Settled { iterate: begun, information: None, stands: nothing_varies, is_hopeless: false };
        let mut levels = best.iterate.clone();
        let mut known = None;
        for round in 0..settings.fit_rounds {
            if best.stands {
                break;
            }
            let Ascent { at, starts, end, information, passes } =
                self.ascent(&levels, known.take(), round == 0, least)?;
            let is_top = end == End::Top;
            if end == End::Hopeless {
                best.information = (at == best.iterate.at).then_some(information);
                best.is_hopeless = true;
                break;
            }
            if at == levels.at {
                if round == 0 && is_top {
                    // The predicted gain was too small for a rough look.
                    known = Some(passes);
                    continue;
                }
                // Levels that were found here are found again.
                best.information = (at == best.iterate.at).then_some(information);
                best.stands = is_top && best.information.is_some();
                break;
            }
            for (run, (start, own)) in levels.followed.iter_mut().zip(starts) {
                (run.fitted.start, run.fitted.covariance) = (start, own);
            }
            let Ok(followed) = self.followed(&at, Some(&levels.followed)) else { break };
            let with_old_levels = passes.log_likelihood() + self.log_prior(&at);
            let are_alike = levels
                .followed
                .iter()
                .zip(&followed)
                .all(|(a, b)| a.noise.disturbance.is_some() == b.noise.disturbance.is_some());
            let log_before = levels.log_posterior;
            levels = Iterate { log_posterior: self.log_posterior(&at, &followed), at, followed };
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
        if !runs.iter().any(|run| run.noise.disturbance.is_some()) || !runs.iter().all(is_close) {
            return None;
        }
        let followed: Vec<Followed> = runs.iter().map(Followed::without_disturbance).collect();
        let log_posterior = self.log_posterior(&iterate.at, &followed);
        Some(Iterate { at: iterate.at.clone(), log_posterior, followed })
    }

    pub fn fitted(
        &self,
        best: Iterate,
        before: f64,
        information: &DMatrix<f64>,
        held: &[bool],
        stands: bool,
    ) -> Fitted {
        let n = self.parameters.len();
        let inverse = Cholesky::new(information.clone());
        let covariance =
            inverse.as_ref().map_or_else(|| DMatrix::from_element(n, n, f64::NAN), |c| c.inverse());
        // log of the posterior's determinant over the prior's.
        let narrower: f64 =
            inverse.as_ref().map_or(f64::NAN, |c| c.l().diagonal().iter().map(|x| x.ln()).sum());
        let known: f64 = self.parameters.iter().filter(|p| p.stddev.is_finite()).map(|p| p.stddev.ln()).sum();
        Fitted {
            log_evidence: best.log_posterior - narrower - known,
            log_posterior: best.log_posterior,
            log_posterior_before: before,
            covariance,
            at_bound: held.to_vec(),
            at: best.at,
            followed: best.followed,
            stands,
        }
    }
}
