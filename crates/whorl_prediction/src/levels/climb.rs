//! Levels with which a run is likeliest, by Newton's steps in the logarithms of their variances.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::scores::{Level, Scores};
use crate::filter::{Filter, Likelihood};
use crate::innovations::Innovation;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::settings::Settings;
use crate::start::Start;
use crate::trail::Trail;

/// Memory for a block of a way at most \[bytes\]: two minutes or more of three sensors at 100 Hz, several times the longest correlation time.
const MOST_BYTES: usize = 24 << 20;
/// A variance changes by this factor at most in a step.
const LARGEST_STEP: f64 = 100.0;
/// What is tried of a step that makes the run less likely as a whole.
const SHARES_OF_A_STEP: [f64; 3] = [1.0, 0.3, 0.1];
/// Over a part of a run, from which a longer one sets out, levels stand when a step brings less than so many times what it would have to.
const ROUGHLY: f64 = 10.0;
/// Information on the logarithm of a variance of which nothing is known: a step then changes a level by a factor of ten or so.
const LEAST_INFORMATION: f64 = 0.05;
/// That is doubled so often at most: up to more than any recording has.
const DAMPINGS: usize = 64;

/// Levels, and how likely a run or its first part is with them.
pub(super) struct Place {
    pub noise: Noise,
    pub start: Start,
    /// log p of the part, and of the part and the levels.
    pub log: f64,
    objective: f64,
    levels: Vec<Level>,
    scores: Scores,
}

/// Climbs from levels on; `None` where the motion is lost with them. Of the first so many instants roughly; of the whole run torques that do not show are
/// left out, and never come back.
pub(super) fn climb(
    case: &Prepared<'_>,
    stated: &Noise,
    noise: Noise,
    start: &Start,
    first: Option<usize>,
) -> Option<Place> {
    let settings = case.settings();
    let most = first.unwrap_or(usize::MAX);
    let stands_nats = settings.level_stands_nats * if first.is_some() { ROUGHLY } else { 1.0 };
    let mut here = Place::of(case, stated, noise, start, most, f64::NEG_INFINITY)?;
    let mut needed = Vec::new();
    for _ in 0..settings.level_steps {
        let Some(step) = Step::of(&here, stated, settings) else { break };
        let unseen = if first.is_none() { here.unseen(settings.level_seen_nats) } else { Vec::new() };
        let next_with = |share: f64, without: &[Level], least| {
            let noise = moved(&here.noise, &here.levels, &step.by, share, without);
            Place::of(case, stated, noise, &here.start, most, least)
        };
        let is_close = step.gain_nats <= stands_nats;
        let least = here.objective - settings.level_seen_nats * unseen.len() as f64;
        let is_asked = !unseen.is_empty() && unseen != needed;
        let mut next =
            is_asked.then(|| next_with(if is_close { 0.0 } else { 1.0 }, &unseen, least)).flatten();
        if next.is_none() {
            needed = unseen;
            if is_close {
                break;
            }
            next = SHARES_OF_A_STEP.iter().find_map(|share| next_with(*share, &[], here.objective));
        }
        let Some(next) = next else { break };
        here = next;
    }
    Some(here)
}

impl Place {
    /// `None` where the motion is lost, or nothing is likelier than `least`.
    fn of(
        case: &Prepared<'_>,
        stated: &Noise,
        noise: Noise,
        start: &Start,
        most: usize,
        least: f64,
    ) -> Option<Self> {
        let start = start.with_levels(case, &noise);
        let levels = Level::all(case, &noise);
        let prior: f64 = levels.iter().map(|level| log_prior(*level, &noise, stated, case.settings())).sum();
        let (scores, log) = scored(case, &noise, &start, &levels, most, least - prior)?;
        Some(Self { noise, start, log, objective: log + prior, levels, scores })
    }

    /// Torques that make the part hardly likelier, whatever their levels.
    fn unseen(&self, least_nats: f64) -> Vec<Level> {
        let torques = self.levels.iter().enumerate().filter(|(_, level)| level.is_torque());
        torques.filter(|(i, _)| self.scores.worth_nats(*i) < least_nats).map(|(_, level)| *level).collect()
    }
}

/// What the first so many instants of a recording say of its levels, and log p of them; `None` where the motion is lost, or log p is not above `least`.
pub(super) fn scored(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    levels: &[Level],
    most: usize,
    least: f64,
) -> Option<(Scores, f64)> {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    let mut likelihood = Likelihood::begun(filter.log_known);
    filter.trail = Some(Trail::new(start.layout, DMatrix::zeros(0, 0), MOST_BYTES));
    let mut scores = Scores::none(levels.len());
    for instants in 1.. {
        let goes_on =
            instants <= most && filter.step(&mut |innovation: &Innovation| likelihood.add(innovation));
        // It keeps what it was given.
        let trail = filter.trail.as_mut()?;
        if goes_on && !trail.is_full() {
            continue;
        }
        let is_likelier = likelihood.log > least;
        if !goes_on && (filter.mean.lost || !is_likelier) {
            return None;
        }
        scores.add(&Scores::of(trail, levels, noise));
        if !goes_on {
            break;
        }
        trail.begin_next();
    }
    Some((scores, likelihood.log))
}

/// A step of the logarithms of variances.
struct Step {
    by: DVector<f64>,
    /// What it gains by gradient and information.
    gain_nats: f64,
}

impl Step {
    /// Of squares A and what is expected of them, B, the step is that of A log(A/B): exact at once where a level makes all of what
    /// readings show, and Newton's close to the top, where A is B.
    fn of(place: &Place, stated: &Noise, settings: &Settings) -> Option<Self> {
        let Place { noise, levels, scores, .. } = place;
        let count = levels.len();
        let (mut slope, mut pull) = (DVector::zeros(count), DVector::zeros(count));
        let mut information: DMatrix<f64> = scores.information.clone();
        for (i, level) in levels.iter().enumerate() {
            let (squares, expected) = (scores.squares[i], scores.expected[i]);
            let (known, of_prior) = if level.is_torque() {
                (LEAST_INFORMATION, 0.0)
            } else {
                (known(settings), -known(settings) * off(*level, noise, stated))
            };
            slope[i] = squares - expected + of_prior;
            // What no reading shows has neither.
            let towards = squares * (squares / expected).ln();
            pull[i] = of_prior + if towards.is_finite() { towards } else { 0.0 };
            information[(i, i)] += known;
        }
        // Far from the top it may lead down where levels do the same; that of the gradient itself never does.
        let by = within(&information, &pull)?;
        let by = if by.dot(&slope) > 0.0 { by } else { within(&information, &slope)? };
        let gain_nats = 0.5 * by.dot(&slope);
        gain_nats.is_finite().then_some(Self { by, gain_nats })
    }
}

/// A step in this direction that changes no level by more than it may, by as much further information as that takes: Levenberg, *Quarterly of Applied
/// Mathematics* 2 (1944) 164.
fn within(information: &DMatrix<f64>, towards: &DVector<f64>) -> Option<DVector<f64>> {
    let count = towards.len();
    let mut further = 0.0;
    for _ in 0..DAMPINGS {
        let step = Cholesky::new(information + DMatrix::identity(count, count) * further)?.solve(towards);
        if step.amax() <= LARGEST_STEP.ln() {
            return Some(step);
        }
        further = if further > 0.0 { 2.0 * further } else { LEAST_INFORMATION };
    }
    None
}

/// The same noise with levels this share of a step further, and without those that are not seen.
fn moved(noise: &Noise, levels: &[Level], by: &DVector<f64>, share: f64, unseen: &[Level]) -> Noise {
    let mut moved = noise.clone();
    for (level, by) in levels.iter().zip(by) {
        let factor = if unseen.contains(level) { 0.0 } else { (0.5 * share * by).exp() };
        level.set(&mut moved, level.stddev(noise) * factor);
    }
    moved.disturbance.forget_silent();
    moved
}

/// Information that a stated level of a reading is, on the logarithm of its variance.
fn known(settings: &Settings) -> f64 {
    0.25 * settings.stated_noise_factor.ln().powi(-2)
}

/// How far a level is from the stated one, as the logarithm of their variances' ratio.
fn off(level: Level, noise: &Noise, stated: &Noise) -> f64 {
    2.0 * (level.stddev(noise) / level.stddev(stated)).ln()
}

fn log_prior(level: Level, noise: &Noise, stated: &Noise, settings: &Settings) -> f64 {
    if level.is_torque() { 0.0 } else { -0.5 * known(settings) * off(level, noise, stated).powi(2) }
}
