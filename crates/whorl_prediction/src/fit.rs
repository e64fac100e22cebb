//! Parameters of a model by the likelihood of recordings: Gauss and Newton's steps through the filter's own sensitivities.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::error::PredictionError;
use crate::fitted::LARGEST_MISFIT;
use crate::levels::{Followed, follow, follow_again, stands};
use crate::noise::Noise;
use crate::other::Varied;
use crate::parameter::Parameter;
use crate::passes::{Passes, pass};
use crate::prepared::Prepared;
use crate::settings::Settings;
use crate::start::Start;

/// What is tried of a step that makes the recordings less likely as a whole.
const SHARES_OF_A_STEP: [f64; 4] = [1.0, 0.5, 0.2, 0.05];

/// Models by their parameters; `None` where no platform has such values.
pub type ModelAt<'a> = dyn Fn(&[f64]) -> Option<PlatformModel> + Sync + 'a;

/// Parameters that recordings show.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The likeliest values, prior included.
    pub at: Vec<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Which stay at an end of their range.
    pub at_bound: Vec<bool>,
    /// Each recording with the model there.
    pub followed: Vec<Followed>,
    /// log p of the recordings and the values, with the levels of noise that each shows [natural logarithm].
    pub log_posterior: f64,
    /// The same where the fit began.
    pub log_posterior_before: f64,
    /// log p of the recordings, whatever the values: Laplace's integral over a normal posterior.
    pub log_evidence: f64,
    /// Whether the values stand.
    pub stands: bool,
}

/// Fits parameters to recordings, beginning with the likeliest of these values, and never less likely than it. Values that no
/// platform has are passed over.
///
/// # Errors
/// See [`PredictionError`]; one of the starts must be a model.
pub fn fit(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    starts: &[Vec<f64>],
    settings: &Settings,
) -> Result<Fitted, PredictionError> {
    let settings = &Settings { derivatives_held: settings.fit_derivatives_held, ..*settings };
    let search = Search { recordings, parameters, model_at, settings };
    let begun = search.begun(starts)?;
    let before = begun.log_posterior;
    let mut best = search.settled(begun, f64::NEG_INFINITY)?;
    // Beside disturbances parameters hardly matter, and both shrink slowly: the model alone may explain everything by now.
    if let Some(alone) = search.alone(&best.standing) {
        let alone = search.settled(alone, best.standing.log_posterior)?;
        if alone.standing.log_posterior > best.standing.log_posterior {
            best = alone;
        }
    }
    let information = match best.information {
        Some(found) => found,
        None => search.passes(&best.standing.at, &best.standing.runs())?.information(parameters),
    };
    let held = search.held(&best.standing.at, &DVector::zeros(parameters.len()));
    Ok(search.fitted(best.standing, before, &information, &held, best.stands))
}

/// Where a search ended.
struct Settled {
    standing: Standing,
    /// The information on the parameters there, if it is known.
    information: Option<DMatrix<f64>>,
    stands: bool,
}

/// A place of the search: values, and the recordings with the model there.
#[derive(Debug, Clone)]
struct Standing {
    at: Vec<f64>,
    log_posterior: f64,
    followed: Vec<Followed>,
}

impl Standing {
    fn runs(&self) -> Vec<(Noise, Start)> {
        self.followed.iter().map(|run| (run.noise.clone(), run.fitted.start.clone())).collect()
    }
}

/// Where values are likeliest at fixed levels.
struct Climbed {
    at: Vec<f64>,
    /// The recordings' starts there.
    starts: Vec<Start>,
    is_top: bool,
    /// Too little was promised to become as likely as it should.
    is_hopeless: bool,
    information: DMatrix<f64>,
}

struct Search<'a> {
    recordings: &'a [Recording],
    parameters: &'a [Parameter],
    model_at: &'a ModelAt<'a>,
    settings: &'a Settings,
}

impl Search<'_> {
    fn model(&self, at: &[f64]) -> Result<PlatformModel, PredictionError> {
        (self.model_at)(at).ok_or(PredictionError::NoModel)
    }

    fn log_prior(&self, at: &[f64]) -> f64 {
        self.parameters.iter().zip(at).map(|(p, x)| -0.5 * (x / p.stddev).powi(2)).sum()
    }

    fn log_posterior(&self, at: &[f64], followed: &[Followed]) -> f64 {
        followed.iter().map(Followed::log_likelihood).sum::<f64>() + self.log_prior(at)
    }

    /// Each recording with the levels and the start that it shows with the model there.
    fn followed(&self, at: &[f64], before: Option<&[Followed]>) -> Result<Vec<Followed>, PredictionError> {
        let model = self.model(at)?;
        let runs: Vec<usize> = (0..self.recordings.len()).collect();
        each(&runs, self.settings.threads, |run| {
            let case = Prepared::new(&self.recordings[*run], &model, *self.settings)?;
            let stated = Noise::stated(&case)?;
            let before = before.and_then(|before| before.get(*run));
            Ok(before.map_or_else(|| follow(&case, &stated), |before| follow_again(&case, &stated, before)))
        })
        .into_iter()
        .collect()
    }

    /// The likeliest of these values with the levels that it shows.
    fn begun(&self, starts: &[Vec<f64>]) -> Result<Standing, PredictionError> {
        let mut best: Option<Standing> = None;
        for at in starts {
            let followed = match self.followed(at, best.as_ref().map(|best| &best.followed[..])) {
                Err(PredictionError::NoModel) => continue,
                other => other?,
            };
            let here =
                Standing { log_posterior: self.log_posterior(at, &followed), at: at.clone(), followed };
            if best.as_ref().is_none_or(|best| here.log_posterior > best.log_posterior) {
                best = Some(here);
            }
        }
        best.ok_or(PredictionError::NoModel)
    }

    /// Values and levels by turns, until both stand, or nothing likelier than `least` is in sight.
    fn settled(&self, begun: Standing, least: f64) -> Result<Settled, PredictionError> {
        let settings = self.settings;
        let mut best = Settled { standing: begun, information: None, stands: self.parameters.is_empty() };
        let mut levels = best.standing.clone();
        for round in 0..settings.fit_rounds {
            if best.stands {
                break;
            }
            let Climbed { at, starts, is_top, is_hopeless, information } =
                self.climbed(&levels, round == 0, least)?;
            if is_hopeless {
                break;
            }
            if at == levels.at {
                if round == 0 {
                    // Too little was promised for a rough look.
                    continue;
                }
                // Levels that were found here are found again.
                best.information = (at == best.standing.at).then_some(information);
                best.stands = is_top && best.information.is_some();
                break;
            }
            for (run, start) in levels.followed.iter_mut().zip(starts) {
                run.fitted.start = start;
            }
            let Ok(followed) = self.followed(&at, Some(&levels.followed)) else { break };
            let same = levels.followed.iter().zip(&followed).all(|(a, b)| {
                a.noise.disturbance.is_some() == b.noise.disturbance.is_some()
                    && stands(&a.noise, &b.noise, settings.level_stands)
            });
            let log_before = levels.log_posterior;
            levels = Standing { log_posterior: self.log_posterior(&at, &followed), at, followed };
            if levels.log_posterior > best.standing.log_posterior {
                best.standing = levels.clone();
                // Levels that stand make the same of the parameters.
                best.information = same.then_some(information);
            }
            let gains = levels.log_posterior - log_before > settings.fit_round_nats;
            best.stands = same && is_top || !gains;
        }
        Ok(best)
    }

    /// The same values without disturbances, where there are any and the model is close to the recordings without them.
    fn alone(&self, standing: &Standing) -> Option<Standing> {
        let runs = &standing.followed;
        let is_close = |run: &Followed| run.likelihood_alone.misfit() < LARGEST_MISFIT;
        if !runs.iter().any(|run| run.noise.disturbance.is_some()) || !runs.iter().all(is_close) {
            return None;
        }
        let followed: Vec<Followed> = runs.iter().map(Followed::without_disturbance).collect();
        let log_posterior = self.log_posterior(&standing.at, &followed);
        Some(Standing { at: standing.at.clone(), log_posterior, followed })
    }

    /// The likeliest values with these levels: roughly while levels are those of another model.
    fn climbed(&self, begun: &Standing, roughly: bool, least: f64) -> Result<Climbed, PredictionError> {
        let (settings, parameters) = (self.settings, self.parameters);
        let stands_nats = if roughly { settings.fit_round_nats } else { settings.fit_stands_nats };
        let (mut at, mut runs) = (begun.at.clone(), begun.runs());
        let starts = |runs: Vec<(Noise, Start)>| runs.into_iter().map(|(_, start)| start).collect();
        let mut here = self.passes(&at, &runs)?;
        let ended = |at, runs, is_top, is_hopeless, information| Climbed {
            at,
            starts: starts(runs),
            is_top,
            is_hopeless,
            information,
        };
        for _ in 0..settings.fit_steps {
            let log = here.log_likelihood() + self.log_prior(&at);
            let slope = here.slope(parameters, &at);
            let held = self.held(&at, &slope);
            let information = here.information(parameters);
            let Some(step) = solved(&information, &slope, &held) else { break };
            if 0.5 * step.dot(&slope) <= stands_nats * here.misfit() {
                return Ok(ended(at, runs, true, false, information));
            }
            // Twice what a parabola promises.
            if log + step.dot(&slope) < least {
                return Ok(ended(at, runs, false, true, information));
            }
            // The change of gains is no part of the slope: at the top nothing is likelier in its direction.
            let is_close = 0.5 * step.dot(&slope) <= settings.fit_round_nats * here.misfit();
            let shares = if is_close { &SHARES_OF_A_STEP[..1] } else { &SHARES_OF_A_STEP };
            let tried = shares.iter().find_map(|share| {
                let next = self.within(&at, &(&step * *share));
                let moved = DVector::from_iterator(at.len(), next.iter().zip(&at).map(|(a, b)| a - b));
                let next_runs = here.moved(&runs, &moved, *share);
                let passes = self.passes(&next, &next_runs).ok()?;
                (passes.log_likelihood() + self.log_prior(&next) > log).then_some((next, next_runs, passes))
            });
            let Some(next) = tried else {
                return Ok(ended(at, runs, is_close, false, information));
            };
            (at, runs, here) = next;
        }
        let information = here.information(parameters);
        Ok(ended(at, runs, false, false, information))
    }

    /// Which parameters stand at an end of their range that the slope does not lead away from.
    fn held(&self, at: &[f64], slope: &DVector<f64>) -> Vec<bool> {
        let ends = self.parameters.iter().zip(at).zip(slope.iter());
        ends.map(|((p, x), up)| (*x <= p.range.0 && *up <= 0.0) || (*x >= p.range.1 && *up >= 0.0)).collect()
    }

    fn within(&self, at: &[f64], step: &DVector<f64>) -> Vec<f64> {
        let moved = self.parameters.iter().zip(at).zip(step.iter());
        moved.map(|((p, x), step)| (x + step).max(p.range.0).min(p.range.1)).collect()
    }

    /// Passes over all recordings.
    fn passes(&self, at: &[f64], runs: &[(Noise, Start)]) -> Result<Passes, PredictionError> {
        let model = self.model(at)?;
        let varied = self.varied(at)?;
        let pairs: Vec<_> = self.recordings.iter().zip(runs).collect();
        let found = each(&pairs, self.settings.threads, |(recording, (noise, start))| {
            let case = Prepared::new(recording, &model, *self.settings)?;
            pass(&case, noise, start, &varied)
        });
        Ok(Passes(found.into_iter().collect::<Result<_, _>>()?))
    }

    /// Models a little further along each parameter, on the side where there is one.
    fn varied(&self, at: &[f64]) -> Result<Vec<Varied>, PredictionError> {
        let step = |(i, parameter): (usize, &Parameter)| {
            let size = self.settings.fit_difference * parameter.stddev.min(1.0);
            [size, -size].into_iter().find_map(|step| {
                let mut moved = at.to_vec();
                moved[i] += step;
                let inside = (parameter.range.0..=parameter.range.1).contains(&moved[i]);
                inside.then(|| (self.model_at)(&moved)).flatten().map(|model| Varied { model, step })
            })
        };
        let all: Option<Vec<Varied>> = self.parameters.iter().enumerate().map(step).collect();
        all.ok_or(PredictionError::NoModel)
    }

    fn fitted(
        &self,
        best: Standing,
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

/// The step that leaves the held parameters where they are.
fn solved(information: &DMatrix<f64>, slope: &DVector<f64>, held: &[bool]) -> Option<DVector<f64>> {
    let (mut information, mut slope) = (information.clone(), slope.clone());
    for i in (0..held.len()).filter(|i| held[*i]) {
        information.row_mut(i).fill(0.0);
        information.column_mut(i).fill(0.0);
        information[(i, i)] = 1.0;
        slope[i] = 0.0;
    }
    let step = Cholesky::new(information)?.solve(&slope);
    step.iter().all(|x| x.is_finite()).then_some(step)
}

/// The same for each, in order; on one thread, or on all.
fn each<T: Sync, R: Send>(items: &[T], threads: usize, of: impl Fn(&T) -> R + Sync) -> Vec<R> {
    if threads.min(items.len()) < 2 {
        return items.iter().map(of).collect();
    }
    items.par_iter().map(&of).collect()
}
