//! Levels with which a run is likeliest, by Newton's steps in the logarithms of their variances.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::list::{Level, Levels};
use super::scores::Scores;
use super::trail::Trail;
use crate::filter::Filter;
use crate::innovations::Innovation;
use crate::likelihood::Likelihood;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::settings::Settings;
use crate::start::Start;

/// A variance changes by this factor at most in a step.
const LARGEST_STEP: f64 = 100.0;
/// What is tried of a step that makes the run less likely as a whole.
const SHARES_OF_A_STEP: [f64; 3] = [1.0, 0.3, 0.1];
/// Over a part of a run, from which a longer one sets out, levels stand when a step brings less than so many times what it would have to.
const ROUGHLY: f64 = 10.0;
/// Information on the logarithm of a variance of which nothing is known: a step then changes a level by a factor of ten or so.
const LEAST_INFORMATION: f64 = 0.05;

/// Levels, and how likely a run or its first part is with them.
pub(super) struct Climbed {
    pub noise: Noise,
    pub start: Start,
    /// log p of the part, and how many instants it has.
    pub log: f64,
    pub instants: usize,
    /// It is no longer than it is because of the memory that it fills.
    pub is_cut: bool,
}

/// Climbs from levels on over the first so many instants; `None` where the motion is lost with them. `forgets`: torques that are not
/// seen are left out, and never come back.
pub(super) fn climb(
    case: &Prepared<'_>,
    stated: &Noise,
    noise: Noise,
    start: &Start,
    most: usize,
    forgets: bool,
) -> Option<Climbed> {
    let settings = case.settings();
    let stands_nats = if forgets { settings.level_stands_nats } else { ROUGHLY * settings.level_stands_nats };
    let mut here = Place::of(case, stated, noise, start, most)?;
    for _ in 0..settings.level_steps {
        let levels = Levels::of(case, &here.climbed.noise);
        // Two would take twice the memory.
        let Some(trail) = here.trail.take() else { break };
        let scores = Scores::of(&trail, &levels, &here.climbed.noise);
        drop(trail);
        let Some(step) = Step::of(&levels, &scores, &here.climbed.noise, stated, settings) else { break };
        // What does not show is worth nothing.
        let unseen = if forgets { scores.unseen(&levels, settings.level_seen_nats) } else { Vec::new() };
        let shares = if step.gain_nats > stands_nats {
            &SHARES_OF_A_STEP[..]
        } else if unseen.is_empty() {
            break;
        } else {
            &[0.0]
        };
        let least = here.objective - settings.level_seen_nats * unseen.len() as f64;
        let next = shares.iter().find_map(|share| {
            let noise = moved(&here.climbed.noise, &levels, &step.by, *share, &unseen);
            Place::of(case, stated, noise, &here.climbed.start, most).filter(|next| next.objective > least)
        });
        let Some(next) = next else { break };
        here = next;
    }
    Some(here.climbed)
}

/// Levels on the way.
struct Place {
    climbed: Climbed,
    trail: Option<Trail>,
    /// log p of the part and of the levels.
    objective: f64,
}

impl Place {
    fn of(case: &Prepared<'_>, stated: &Noise, noise: Noise, start: &Start, most: usize) -> Option<Self> {
        let start = start.with_levels(case, &noise);
        let (trail, log) = way(case, &noise, &start, most)?;
        let levels = Levels::of(case, &noise);
        let prior: f64 = levels.iter().map(|level| log_prior(level, &noise, stated, case.settings())).sum();
        let (instants, is_cut) = (trail.instants.len(), trail.is_full());
        let climbed = Climbed { noise, start, log, instants, is_cut };
        Some(Self { objective: log + prior, climbed, trail: Some(trail) })
    }
}

/// The way of a filter through the first so many instants of a recording, or fewer where they would fill more than 128 MB, and log p of them; `None` where the
/// motion is lost.
pub(super) fn way(case: &Prepared<'_>, noise: &Noise, start: &Start, most: usize) -> Option<(Trail, f64)> {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    let mut likelihood = Likelihood::begun(filter.log_known);
    filter.trail = Some(Trail::new(start.layout));
    let mut count = |innovation: &Innovation| likelihood.add(innovation);
    let has_room = |trail: &Trail| trail.instants.len() < most && !trail.is_full();
    while filter.trail.as_ref().is_some_and(has_room) && filter.step(&mut count) {}
    let is_lost = filter.is_lost() || !likelihood.log.is_finite();
    let trail = filter.trail.take().filter(|_| !is_lost)?;
    Some((trail, likelihood.log))
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
    fn of(
        levels: &Levels,
        scores: &Scores,
        noise: &Noise,
        stated: &Noise,
        settings: &Settings,
    ) -> Option<Self> {
        let count = levels.count();
        let (mut slope, mut pull) = (DVector::zeros(count), DVector::zeros(count));
        let mut information: DMatrix<f64> = scores.information.clone();
        for (i, level) in levels.iter().enumerate() {
            let (squares, expected) = (scores.squares[i], scores.expected[i]);
            let (known, of_prior) = if level.is_torque() {
                (LEAST_INFORMATION, 0.0)
            } else {
                (known(settings), -known(settings) * off(level, noise, stated))
            };
            slope[i] = squares - expected + of_prior;
            pull[i] = squares * (squares / expected).ln() + of_prior;
            information[(i, i)] += known;
        }
        let most = LARGEST_STEP.ln();
        let solved = Cholesky::new(information)?;
        let step = |towards: &DVector<f64>| solved.solve(towards).map(|x| x.clamp(-most, most));
        // Far from the top it may lead down where levels do the same; that of the gradient itself never does.
        let by = Some(step(&pull)).filter(|by| by.dot(&slope) > 0.0).unwrap_or_else(|| step(&slope));
        let gain_nats = 0.5 * by.dot(&slope);
        gain_nats.is_finite().then_some(Self { by, gain_nats })
    }
}

/// The same noise with levels this share of a step further, and without those that are not seen.
fn moved(noise: &Noise, levels: &Levels, by: &DVector<f64>, share: f64, unseen: &[Level]) -> Noise {
    let mut moved = noise.clone();
    for (level, by) in levels.iter().zip(by.iter()) {
        let factor = if unseen.contains(&level) { 0.0 } else { (0.5 * share * by).exp() };
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
