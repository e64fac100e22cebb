//! The start that a run shows with a model in force.

use nalgebra::DMatrix;
use whorl_math::covariance::narrowed;

use crate::passes::Pass;
use crate::start::guesses;
use crate::{Likelihood, Noise, Prepared, Start};

/// Part of a run after which what it says of its start is looked at first; doubled from there on.
const FIRST_PART: f64 = 1.0 / 64.0;
const FEWEST_INSTANTS: usize = 20;
/// More of the run says nothing new of the start when its deviations change by less than this share.
const SETTLED: f64 = 0.01;
/// Part of a run by which the likeliest of several guesses is chosen.
const SHARE_TO_CHOOSE: f64 = 0.25;
/// Mean square of normalised innovations above which a model does not explain a run, whatever its start.
pub(crate) const LARGEST_MISFIT: f64 = 4.0;
/// Steps from a start that is close already: a second shows that the first was enough.
const NEAR_PASSES: usize = 2;
const SHARES_OF_A_STEP: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.03];
/// Parts and narrowings at most; six doublings reach the whole run, and two or three narrowings follow.
const MOST_ROUNDS: usize = 24;

/// A start that the run shows.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedStart {
    /// The likeliest start, where a filter begins: its covariance has what was known before the run, and the share
    /// [`crate::Settings::start_kept`] of what the run says.
    pub start: Start,
    /// Covariance given all readings that were looked at, in the layout's coordinates.
    pub covariance: DMatrix<f64>,
    /// How many numbers the run determined of it: the sum of one less variance after the run over variance before.
    pub determined: f64,
}

/// The start that a run shows with this model: what the run says is carried back to it until it stands. Of several guesses the likeliest is followed.
pub fn fitted_start(case: &Prepared<'_>, noise: &Noise) -> FittedStart {
    fitted_start_within(case, noise, case.instants())
}

/// The same by the first instants alone, at most so many.
pub(crate) fn fitted_start_within(case: &Prepared<'_>, noise: &Noise, most: usize) -> FittedStart {
    let whole = most.min(case.instants());
    let wide = Start::wide(case, noise);
    let improved = |start, most| Passed::improved((case, noise), start, most, |_| true);
    let guesses = guesses(case, &wide);
    let mut start = wide.clone();
    if guesses.len() > 1 {
        let part = (whole as f64 * SHARE_TO_CHOOSE) as usize;
        let tried = guesses.into_iter().map(|guess| improved(guess, part));
        if let Some(best) = tried.max_by(|a, b| a.pass.likelihood.log.total_cmp(&b.pass.likelihood.log)) {
            // What was known before is no more than it was.
            start = Start { covariance: wide.covariance.clone(), ..best.start };
        }
    }
    improved(start, whole).fitted(&wide.covariance).0
}

/// The start that the whole run shows without disturbances, close to one that was found with them, and how likely the run is from
/// there. Where no start close by stands, it is looked for further away.
pub(crate) fn fitted_start_near(
    case: &Prepared<'_>,
    noise: &Noise,
    other: &FittedStart,
) -> (FittedStart, Likelihood) {
    let wide = Start::wide(case, noise);
    let (known_before, share, whole) = (wide.covariance.clone(), case.settings().start_kept, case.instants());
    let kept: Vec<usize> = other.start.layout.own().collect();
    let own = other.covariance.select_rows(&kept).select_columns(&kept);
    let covariance = narrowed(&known_before, &own, share);
    let start = Start { covariance, ..wide.about(&other.start) };
    let mut best = Passed::over((case, noise), start, whole);
    let mut stands = false;
    if best.pass.likelihood.misfit() <= LARGEST_MISFIT {
        // As narrow as the whole run makes it, so that the filter is linear over it.
        for _ in 0..NEAR_PASSES {
            let covariance = narrowed(&known_before, &best.pass.sums.own, share);
            let moved = Start { covariance, ..best.start.moved(&best.pass.shift) };
            best = Passed::over((case, noise), moved, whole);
            stands = best.improve(whole, NEAR_PASSES, &[1.0]);
        }
    }
    if !stands {
        // A motion may leave an unstable rest, so that only the exact start tells where it goes: then longer and longer parts of the run lead there. What
        // a model lacks would move the start, not what the run shows of it.
        let again = Start { covariance: known_before.clone(), ..best.start.clone() };
        let longer = Passed::improved((case, noise), again, whole, Likelihood::is_noise);
        if longer.pass.likelihood.log > best.pass.likelihood.log {
            best = longer;
        }
    }
    best.fitted(&known_before)
}

struct Passed<'a> {
    of: (&'a Prepared<'a>, &'a Noise),
    start: Start,
    pass: Pass,
}

impl<'a> Passed<'a> {
    fn over(of: (&'a Prepared<'a>, &'a Noise), start: Start, part: usize) -> Self {
        Self { of, pass: Pass::of_start(of.0, of.1, &start, part), start }
    }

    /// From a start that was improved by longer and longer parts of the run, up to so many instants, while this holds of them; else not likely at all.
    /// On each part the start is moved until it stands. The next one begins with a covariance that has a hundredth of what this one said: a filter whose
    /// start is as wide as what was known before the run would be linear over angles for which the motion is not, however good its mean has become.
    fn improved(
        of: (&'a Prepared<'a>, &'a Noise),
        start: Start,
        most: usize,
        is_good: fn(&Likelihood) -> bool,
    ) -> Self {
        let (settings, whole) = (of.0.settings(), most.max(FEWEST_INSTANTS));
        let mut part = ((of.0.instants() as f64 * FIRST_PART) as usize).max(FEWEST_INSTANTS).min(whole);
        let known_before = start.covariance.clone();
        let mut best = Self::over(of, start, part);
        for _ in 0..MOST_ROUNDS {
            best.improve(part, settings.start_passes, &SHARES_OF_A_STEP);
            if !is_good(&best.pass.likelihood) {
                best.pass.likelihood.lose();
                break;
            }
            let narrowed = narrowed(&known_before, &best.pass.sums.own, settings.start_kept);
            let begun = best.start.covariance.diagonal();
            let becomes = |judge: fn(f64, f64) -> bool| {
                begun.iter().zip(narrowed.diagonal().iter()).all(|(now, next)| judge(*now, *next))
            };
            // What is narrow already has nothing to gain.
            if part >= whole && becomes(|now, next| now <= 2.0 * next) {
                break;
            }
            let settled = becomes(|now, next| (now - next).abs() <= 2.0 * SETTLED * now);
            part = if settled { whole } else { (2 * part).min(whole) };
            best = Self::over(of, Start { covariance: narrowed, ..best.start }, part);
        }
        best
    }

    /// Moves the start until the part is hardly likelier with another one; whether it is.
    fn improve(&mut self, part: usize, passes: usize, shares: &[f64]) -> bool {
        for _ in 0..passes {
            let log = self.pass.likelihood.log;
            let likelier = shares.iter().find_map(|share| {
                let tried = Self::over(self.of, self.start.moved(&(&self.pass.shift * *share)), part);
                (tried.pass.likelihood.log > log).then_some(tried)
            });
            let Some(next) = likelier else { return true };
            *self = next;
            // Errors k times the noise make likelihoods differ k^2 times as much.
            let now = &self.pass.likelihood;
            if now.log - log <= self.of.0.settings().start_stands_nats * now.misfit().max(1.0) {
                return true;
            }
        }
        false
    }

    fn fitted(self, known_before: &DMatrix<f64>) -> (FittedStart, Likelihood) {
        let Pass { sums, likelihood, .. } = self.pass;
        let (before, own) = (sums.seen(known_before).diagonal(), sums.own.diagonal());
        let pairs = before.iter().zip(own.iter()).filter(|(before, _)| **before > 0.0);
        let determined = pairs.map(|(before, own)| 1.0 - (own / before).clamp(0.0, 1.0)).sum();
        (FittedStart { start: self.start, covariance: sums.own, determined }, likelihood)
    }
}
