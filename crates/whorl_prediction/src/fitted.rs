//! The start that a run shows with a model in force.

use nalgebra::{DMatrix, DVector};

use crate::filter::Filter;
use crate::guess::guesses;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::start::Start;

/// Part of a run after which what it says of its start is looked at first; doubled from there on.
const FIRST_PART: f64 = 1.0 / 64.0;
/// Fewest instants of a part.
const FEWEST_INSTANTS: usize = 20;
/// More of the run says nothing new of the start when its deviations change by less than this share.
const SETTLED: f64 = 0.01;
/// Part of a run by which the likeliest of several guesses is chosen.
const SHARE_TO_CHOOSE: f64 = 0.25;
/// What is tried of a step that makes a part less likely as a whole.
const SHARES_OF_A_STEP: [f64; 5] = [1.0, 0.5, 0.25, 0.1, 0.03];
/// Parts and narrowings at most; six doublings reach the whole run, and two or three narrowings follow.
const MOST_ROUNDS: usize = 24;
/// Share of a variance below which a direction counts as certain: rounding of a covariance.
const CERTAIN: f64 = 1e-14;

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
    /// Whether it stood still at the end.
    pub stands: bool,
}

/// The start that a run shows with this model: filters the run, carries what it says back to the start, and filters from
/// there again until the start stands. Of several guesses the likeliest is followed.
#[must_use]
pub fn fitted_start(case: &Prepared<'_>, noise: &Noise) -> FittedStart {
    let wide = Start::wide(case, noise);
    let guesses = guesses(case, &wide);
    if let [only] = guesses.as_slice() {
        return follow(case, noise, only.clone(), 1.0).0;
    }
    let tried = guesses.into_iter().map(|guess| follow(case, noise, guess, SHARE_TO_CHOOSE));
    let best = tried.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(fitted, _)| fitted.start);
    // What was known before is no more than it was.
    let best = best.map(|best| Start { covariance: wide.covariance.clone(), ..best });
    follow(case, noise, best.unwrap_or(wide), 1.0).0
}

/// Improves a start by longer and longer parts of the run, up to a share of it; with the log likelihood of the last part.
///
/// On each part the start is moved until it stands: where a step makes the part less likely, a part of the step is tried. The
/// next part begins with a covariance that has a hundredth of what this one said: a filter whose start is as wide as what was
/// known before the run would be linear over angles for which the motion is not, however good its mean has become.
fn follow(case: &Prepared<'_>, noise: &Noise, start: Start, share: f64) -> (FittedStart, f64) {
    let instants = case.instants();
    let whole = ((instants as f64 * share) as usize).max(FEWEST_INSTANTS);
    let mut part = ((instants as f64 * FIRST_PART) as usize).max(FEWEST_INSTANTS).min(whole);
    let known_before = start.covariance.clone();
    let mut best = Passed::over(case, noise, start, part);
    let mut stands = false;
    for _ in 0..MOST_ROUNDS {
        stands = best.improve(case, noise, part);
        let narrowed = narrowed(&known_before, &best.own, case.settings().start_kept);
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
        best = Passed::over(case, noise, Start { covariance: narrowed, ..best.start }, part);
    }
    (best.fitted(&known_before, stands), best.log)
}

/// A covariance with this share of the information that a run adds to what was known before: `own` is what both say together.
/// Directions of which nothing was uncertain stay certain.
fn narrowed(before: &DMatrix<f64>, own: &DMatrix<f64>, share: f64) -> DMatrix<f64> {
    // In coordinates in which what was known before is a unit matrix: before = B B^T, own = B M B^T with M <= 1.
    let n = before.nrows();
    let scale = before.diagonal().map(|p| p.max(0.0).sqrt());
    let unit = |i: usize| if scale[i] > 0.0 { 1.0 / scale[i] } else { 0.0 };
    let shape = DMatrix::from_fn(n, n, |i, j| before[(i, j)] * unit(i) * unit(j)).symmetric_eigen();
    let kept: Vec<usize> = (0..n).filter(|k| shape.eigenvalues[*k] > CERTAIN).collect();
    let basis = DMatrix::from_fn(n, kept.len(), |i, k| {
        scale[i] * shape.eigenvectors[(i, kept[k])] * shape.eigenvalues[kept[k]].sqrt()
    });
    let back = DMatrix::from_fn(kept.len(), n, |k, i| {
        unit(i) * shape.eigenvectors[(i, kept[k])] / shape.eigenvalues[kept[k]].sqrt()
    });
    let said = (&back * own * back.transpose()).symmetric_eigen();
    let kept = said.eigenvalues.map(|mu| 1.0 / (1.0 + share * (1.0 / mu.clamp(CERTAIN, 1.0) - 1.0)));
    let turned = basis * said.eigenvectors;
    &turned * DMatrix::from_diagonal(&kept) * turned.transpose()
}

/// What a pass over a part of a run says of its start.
struct Passed {
    start: Start,
    log: f64,
    shift: DVector<f64>,
    own: DMatrix<f64>,
}

impl Passed {
    fn over(case: &Prepared<'_>, noise: &Noise, start: Start, part: usize) -> Self {
        let mut filter = Filter::new(case, noise, &start).looking_back();
        let (mut taken, mut log) = (0, 0.0);
        while taken < part && filter.step(&mut |innovation| log += innovation.log_likelihood()) {
            taken += 1;
        }
        if filter.lost || !log.is_finite() {
            log = f64::NEG_INFINITY;
        }
        let size = start.covariance.nrows();
        let (shift, own) = match filter.origin {
            Some(origin) if origin.shift.iter().all(|x| x.is_finite()) => (origin.shift, origin.own),
            _ => (DVector::zeros(size), start.covariance.clone()),
        };
        Self { start, log, shift, own }
    }

    /// Moves the start until the part is hardly likelier with another one; whether it is.
    fn improve(&mut self, case: &Prepared<'_>, noise: &Noise, part: usize) -> bool {
        for _ in 0..case.settings().start_passes {
            let Some(next) = self.improved(case, noise, part) else { return true };
            let gain = next.log - self.log;
            *self = next;
            if gain <= case.settings().start_stands_nats {
                return true;
            }
        }
        false
    }

    /// A start that makes the part likelier; `None` where none is found.
    fn improved(&self, case: &Prepared<'_>, noise: &Noise, part: usize) -> Option<Self> {
        SHARES_OF_A_STEP.into_iter().find_map(|share| {
            let tried = Self::over(case, noise, self.start.moved(&(&self.shift * share)), part);
            (tried.log > self.log).then_some(tried)
        })
    }

    fn fitted(&self, known_before: &DMatrix<f64>, stands: bool) -> FittedStart {
        let (before, own) = (known_before.diagonal(), self.own.diagonal());
        let pairs = before.iter().zip(own.iter()).filter(|(before, _)| **before > 0.0);
        let determined = pairs.map(|(before, own)| 1.0 - (own / before).clamp(0.0, 1.0)).sum();
        FittedStart { start: self.start.clone(), covariance: self.own.clone(), determined, stands }
    }
}
