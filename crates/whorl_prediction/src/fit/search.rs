//! Values and levels of noise by turns: at fixed levels the values ascend to the maximum of the posterior, and with them the levels are found anew.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::{Iterate, Problem};
use crate::fitted::LARGEST_MISFIT;
use crate::levels::{Fit, follow_anew, followed_from};
use crate::passes::Pass;
use crate::{Followed, Noise, PredictionError, Prepared};

pub(super) struct Settled {
    pub iterate: Iterate,
    /// The information on the parameters there, if it is known.
    pub information: Option<DMatrix<f64>>,
    pub stands: bool,
    pub is_hopeless: bool,
}

/// What is tried of a step that makes the recordings less likely as a whole.
const SHARES_OF_A_STEP: [f64; 4] = [1.0, 0.5, 0.2, 0.05];
/// A step does what columns have said if its gain is theirs but for this share: Nocedal and Wright, *Numerical Optimization*, algorithm 4.1.
const AS_SAID: f64 = 0.25;

struct Place {
    at: Vec<f64>,
    followed: Vec<Followed>,
    passes: Vec<Pass>,
    /// Columns are those of a place close by.
    is_near: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// No further gain is predicted.
    Top,
    /// The predicted gain is too small to become as likely as it should.
    Hopeless,
    /// The predicted gain is not found, or it took as many steps as it may.
    Stuck,
}

impl Problem<'_> {
    /// Each recording with the levels and the start that it shows with the model there; what the model without disturbances makes of it may be that of before.
    fn followed(
        &self,
        at: &[f64],
        before: Option<&[Followed]>,
        fit: Fit,
    ) -> Result<Iterate, PredictionError> {
        let followed = self.each(at, |case, run| {
            let stated = Noise::stated(case)?;
            Ok(match before.and_then(|before| before.get(run)) {
                Some(before) => followed_from(case, &stated, before, fit),
                None => follow_anew(case, &stated, fit),
            })
        });
        Ok(self.iterate(at, followed?))
    }

    /// The likeliest of these values with the levels that it shows. Those of a rival are taken, if there is one with the same states, while these are
    /// compared: only the likeliest then needs its own, if it is not as likely as the rival, which it may be itself.
    pub fn begun(&self, starts: &[Vec<f64>], rival: &[Followed]) -> Result<Iterate, PredictionError> {
        let by_rival = likeliest(starts, |at, _| Ok((self.log(at, &self.passes_near(at, rival, &[])?), at)));
        if let Ok((log, at)) = by_rival {
            let as_rival = self.iterate(at, rival.to_vec());
            let is_rival = (log - as_rival.log_posterior).abs() < self.settings.fit_round_nats;
            return if is_rival { Ok(as_rival) } else { self.followed(at, Some(rival), Fit::Begun) };
        }
        let best = likeliest(starts, |at, best: Option<&Iterate>| {
            let here = self.followed(at, best.map(|best| &best.followed[..]), Fit::Begun)?;
            Ok((here.log_posterior, here))
        });
        Ok(best?.1)
    }

    /// The likeliest values without random torques, with the levels that they show then.
    pub fn begun_quiet(&self, starts: &[Vec<f64>], rival: &[Followed]) -> Result<Iterate, PredictionError> {
        let quiet: Vec<Followed> = rival.iter().map(Followed::without_disturbance).collect();
        let settled = self.settled(self.begun(starts, &quiet)?, true, f64::NEG_INFINITY)?;
        self.followed(&settled.iterate.at, Some(rival), Fit::Begun)
    }

    /// The same with what else is `found` of each disturbed run, and the values that belong to that.
    pub fn settled_again(
        &self,
        mut best: Settled,
        least: f64,
        found: impl Fn(&Prepared<'_>, &Followed) -> Result<Followed, PredictionError> + Sync,
    ) -> Result<Settled, PredictionError> {
        let followed = self.each(&best.iterate.at, |case, run| {
            let before = &best.iterate.followed[run];
            if before.noise.disturbance.is_some() { found(case, before) } else { Ok(before.clone()) }
        })?;
        let is_other =
            |(a, b): (&Followed, &Followed)| (&a.noise, &a.fitted.start) != (&b.noise, &b.fitted.start);
        let are_others = followed.iter().zip(&best.iterate.followed).any(is_other);
        best.iterate = self.iterate(&best.iterate.at, followed);
        best.information = best.information.filter(|_| !are_others);
        let stays = !are_others || best.is_hopeless;
        if stays { Ok(best) } else { self.settled(best.iterate, false, least) }
    }

    /// Values and levels by turns, until both stand, or nothing likelier than `least` is in sight; first `roughly`, where levels are those of other values.
    pub fn settled(&self, begun: Iterate, roughly: bool, least: f64) -> Result<Settled, PredictionError> {
        let settings = self.settings;
        let stands = self.parameters.is_empty();
        let mut best = Settled { iterate: begun, information: None, stands, is_hopeless: false };
        let mut levels = best.iterate.clone();
        let mut known = None;
        for round in 0..settings.fit_rounds {
            if best.stands {
                break;
            }
            let is_rough = roughly && round == 0;
            let (place, end, information) = self.ascent(&levels, known.take(), is_rough, least)?;
            let is_top = end == End::Top;
            best.is_hopeless = end == End::Hopeless;
            if best.is_hopeless || place.at == levels.at {
                if is_top && is_rough {
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
            // Values that gain so little leave levels as they are, where these stood.
            let gained = with_old_levels - levels.log_posterior;
            if is_top && !roughly && round == 0 && gained <= settings.fit_round_nats {
                let place = if place.is_near { self.with_columns(place)? } else { place };
                best.information = Some(self.normal_equations(&place.at, &place.passes).2);
                (best.iterate, best.stands) = (self.iterate_at(place), true);
                break;
            }
            let mut followed = place.followed;
            let starts = followed.iter_mut().zip(place.passes);
            starts.for_each(|(run, pass)| run.fitted.covariance = pass.sums.own);
            let Ok(next) = self.followed(&place.at, Some(&followed), Fit::OnWay) else { break };
            let is_disturbed = |run: &Followed| run.noise.disturbance.is_some();
            let are_alike = followed.iter().map(is_disturbed).eq(next.followed.iter().map(is_disturbed));
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

    /// The likeliest values with these levels, and the information there: roughly while levels are another model's. `known`: passes where it begins.
    fn ascent(
        &self,
        begun: &Iterate,
        known: Option<Vec<Pass>>,
        roughly: bool,
        least: f64,
    ) -> Result<(Place, End, DMatrix<f64>), PredictionError> {
        let settings = self.settings;
        let stands_nats = if roughly { settings.fit_round_nats } else { settings.fit_stands_nats };
        let passes = known.map_or_else(|| self.passes(&begun.at, &begun.followed), Ok)?;
        let (at, followed) = (begun.at.clone(), begun.followed.clone());
        let mut here = Place { at, followed, passes, is_near: false };
        let mut steps = 0..settings.fit_steps;
        loop {
            let (log, slope, information) = self.normal_equations(&here.at, &here.passes);
            let step = steps.next().and_then(|_| solved(&information, &slope, &self.held(&here.at, &slope)));
            let Some(step) = step else { return Ok((here, End::Stuck, information)) };
            let (predicted, misfit) = (0.5 * step.dot(&slope), misfit(&here.passes));
            if predicted <= stands_nats * misfit {
                return Ok((here, End::Top, information));
            }
            // Twice the gain that a parabola predicts.
            if log + 2.0 * predicted < least {
                return Ok((here, End::Hopeless, information));
            }
            // The change of gains is no part of the slope: at the top nothing is likelier in its direction.
            let is_close = predicted <= settings.fit_round_nats * misfit;
            let shares = if is_close { &SHARES_OF_A_STEP[..1] } else { &SHARES_OF_A_STEP };
            let likelier = shares.iter().find_map(|share| {
                let next = self.moved(&here, &step, *share).ok()?;
                let gain = self.log(&next.at, &next.passes) - log;
                (gain > 0.0).then_some((next, gain))
            });
            here = match likelier {
                // It has its own columns unless it is as much likelier as those of the one before have said.
                Some((next, gain)) => {
                    let by = difference(&here.at, &next.at);
                    let said = by.dot(&slope) - 0.5 * by.dot(&(&information * &by));
                    let small = settings.fit_stands_nats * self::misfit(&next.passes);
                    let is_as_said = (gain - said).abs() <= (AS_SAID * said).max(small);
                    let are_kept = next.passes.iter().all(|pass| pass.kept.is_some());
                    if is_as_said && are_kept { next } else { self.with_columns(next)? }
                }
                None if here.is_near => self.with_columns(here)?,
                None => return Ok((here, if is_close { End::Top } else { End::Stuck }, information)),
            };
        }
    }

    /// A place by this share of a step, with the columns of where it set out; starts go the same share of the way to where the runs show them.
    fn moved(&self, from: &Place, step: &DVector<f64>, share: f64) -> Result<Place, PredictionError> {
        let steps = self.parameters.iter().zip(&from.at).zip(step.iter());
        let at: Vec<f64> =
            steps.map(|((p, x), step)| (x + step * share).max(p.range.0).min(p.range.1)).collect();
        let by = difference(&from.at, &at);
        let mut followed = from.followed.clone();
        for (run, pass) in followed.iter_mut().zip(&from.passes) {
            let start = &mut run.fitted.start;
            let mut shift = &pass.shift * share + &pass.sums.of_start * &by;
            // Of disturbances nothing is known at the start but their levels.
            shift.rows_range_mut(start.layout.plant.size()..start.layout.moving()).fill(0.0);
            *start = start.moved(&shift);
        }
        let passes = self.passes_near(&at, &followed, &from.passes)?;
        Ok(Place { at, followed, passes, is_near: true })
    }

    fn iterate_at(&self, place: Place) -> Iterate {
        let mut followed = place.followed;
        for (run, pass) in followed.iter_mut().zip(place.passes) {
            run.fitted.covariance = pass.sums.own;
            if run.noise.disturbance.is_some() {
                run.gain_nats = pass.likelihood.log - run.undisturbed_likelihood.log;
            } else {
                (run.undisturbed, run.undisturbed_likelihood) = (run.fitted.clone(), pass.likelihood);
            }
        }
        self.iterate(&place.at, followed)
    }

    fn with_columns(&self, place: Place) -> Result<Place, PredictionError> {
        let passes = self.passes(&place.at, &place.followed)?;
        Ok(Place { passes, is_near: false, ..place })
    }

    /// Which parameters stand at an end of their range that the slope does not lead away from.
    pub fn held(&self, at: &[f64], slope: &DVector<f64>) -> Vec<bool> {
        let ends = self.parameters.iter().zip(at).zip(slope.iter());
        ends.map(|((p, x), up)| (*x <= p.range.0 && *up <= 0.0) || (*x >= p.range.1 && *up >= 0.0)).collect()
    }
}

/// The likeliest of these values, with what was found there, given what was found at the best before; those that no platform has are passed over.
fn likeliest<'s, T>(
    starts: &'s [Vec<f64>],
    mut found: impl FnMut(&'s [f64], Option<&T>) -> Result<(f64, T), PredictionError>,
) -> Result<(f64, T), PredictionError> {
    let mut best: Option<(f64, T)> = None;
    for at in starts {
        let here = match found(at, best.as_ref().map(|(_, best)| best)) {
            Err(PredictionError::NoModel) => continue,
            here => here?,
        };
        if best.as_ref().is_none_or(|(most, _)| here.0 > *most) {
            best = Some(here);
        }
    }
    best.ok_or(PredictionError::NoModel)
}

fn difference(from: &[f64], to: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(to) - DVector::from_column_slice(from)
}

/// Mean square of the normalised innovations, 1 at least.
fn misfit(passes: &[Pass]) -> f64 {
    let squares: f64 = passes.iter().map(|pass| pass.likelihood.chi_squared).sum();
    let numbers: usize = passes.iter().map(|pass| pass.likelihood.numbers).sum();
    (squares / numbers.max(1) as f64).max(1.0)
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
