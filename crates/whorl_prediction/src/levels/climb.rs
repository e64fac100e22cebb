//! Levels with which a run is likeliest, by Newton's steps in the logarithms of their variances.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::Fit;
use super::scores::{Level, Scores};
use crate::filter::Filter;
use crate::trail::Trail;
use crate::{Likelihood, Noise, Prepared, Start};

/// A variance changes by this factor at most in a step.
const LARGEST_STEP: f64 = 100.0;
/// What is tried of a step that makes the run less likely as a whole.
const SHARES_OF_A_STEP: [f64; 3] = [1.0, 0.3, 0.1];
/// Over a part of a run, from which a longer one sets out, levels stand when a step brings less than so many times what it would have to. A step that brings
/// less than so many times that is the last: Newton's leaves a tenth of it or so, which needs no gradients to be seen.
const ROUGHLY: f64 = 10.0;
/// Information on the logarithm of a variance of which nothing is known: a step then changes a level by a factor of ten or so.
const LEAST_INFORMATION: f64 = 0.05;
/// That is doubled so often at most: up to more than any recording has.
const DAMPINGS: usize = 64;

/// What levels are found of: a run, or its first so many instants, and the levels that are stated.
struct Part<'a> {
    case: &'a Prepared<'a>,
    stated: &'a Noise,
    most: usize,
}

pub(super) struct Place {
    pub noise: Noise,
    pub start: Start,
    /// log p of the part, and of the part and the levels.
    pub log: f64,
    objective: f64,
    levels: Vec<Level>,
    scores: Scores,
}

/// Climbs from levels on; `None` where the motion is lost with them. Of the first so many instants roughly; of a whole run without torques that do not show.
pub(super) fn climb(
    case: &Prepared<'_>,
    stated: &Noise,
    noise: Noise,
    start: &Start,
    first: Option<usize>,
    fit: Fit,
) -> Option<Place> {
    let settings = case.settings();
    let part = Part { case, stated, most: first.unwrap_or(usize::MAX) };
    let near_nats = settings.level_stands_nats * ROUGHLY;
    let stands_nats = if first.is_some() { near_nats } else { settings.level_stands_nats };
    // With values that still move the wrong torques would be left out far from the top: what each is worth there says nothing of the top.
    let (asked_nats, last_nats) = if matches!(fit, Fit::None | Fit::Judged) {
        (f64::INFINITY, near_nats)
    } else {
        (stands_nats, ROUGHLY * near_nats)
    };
    let mut needed = Vec::new();
    let mut here = part.place(noise, start, f64::NEG_INFINITY, false)?;
    for _ in 0..settings.level_steps {
        let Some((step, gain_nats)) = here.step(&part) else { break };
        let is_asked = first.is_none() && gain_nats <= asked_nats;
        let unseen = if is_asked { here.unseen(settings.level_seen_nats) } else { Vec::new() };
        let next_with = |share: f64, without: &[Level], is_last| {
            let mut noise = here.noise.clone();
            for (level, by) in here.levels.iter().zip(&step) {
                let factor = if without.contains(level) { 0.0 } else { (0.5 * share * by).exp() };
                level.set(&mut noise, level.stddev(&here.noise) * factor);
            }
            noise.disturbance.forget_silent();
            let least = here.objective - settings.level_seen_nats * without.len() as f64;
            part.place(noise, &here.start, least, is_last)
        };
        // Without some of them others may not be seen either.
        let is_new = !unseen.is_empty() && unseen != needed;
        let mut next = is_new.then(|| next_with(1.0, &unseen, false)).flatten();
        if next.is_none() {
            needed = unseen;
        }
        let is_last = next.is_none() && gain_nats <= last_nats;
        if next.is_none() && gain_nats > stands_nats {
            let shares = if is_last { &SHARES_OF_A_STEP[..1] } else { &SHARES_OF_A_STEP };
            next = shares.iter().find_map(|share| next_with(*share, &[], is_last));
        }
        let Some(next) = next else { break };
        here = next;
        if is_last {
            break;
        }
    }
    Some(here)
}

impl Part<'_> {
    /// `None` where the motion is lost, or nothing is likelier than `least`; the last has no scores.
    fn place(&self, noise: Noise, start: &Start, least: f64, is_last: bool) -> Option<Place> {
        let start = start.with_levels(self.case, &noise);
        let levels = Level::all(self.case, &noise);
        let readings = levels.iter().filter(|level| !level.is_torque());
        let prior: f64 = readings.map(|level| -0.5 * self.known() * self.off(*level, &noise).powi(2)).sum();
        let (scores, log) = scored(self.case, &noise, &start, &levels, self.most, least - prior, is_last)?;
        Some(Place { noise, start, log, objective: log + prior, levels, scores })
    }

    /// Information that a stated level of a reading is, on the logarithm of its variance.
    fn known(&self) -> f64 {
        0.25 * self.case.settings().stated_noise_factor.ln().powi(-2)
    }

    /// How far a level is from the stated one, as the logarithm of their variances' ratio.
    fn off(&self, level: Level, noise: &Noise) -> f64 {
        2.0 * (level.stddev(noise) / level.stddev(self.stated)).ln()
    }
}

impl Place {
    /// Torques that make the part hardly likelier, whatever their levels.
    fn unseen(&self, least_nats: f64) -> Vec<Level> {
        let torques = self.levels.iter().enumerate().filter(|(_, level)| level.is_torque());
        torques.filter(|(i, _)| self.scores.worth_nats(*i) < least_nats).map(|(_, level)| *level).collect()
    }

    /// A step of the logarithms of variances, and what it gains by gradient and information. Of squares A and what is expected of them, B, it is that of
    /// A log(A/B): exact at once where a level makes all of what readings show, and Newton's close to the top, where A is B.
    fn step(&self, part: &Part<'_>) -> Option<(DVector<f64>, f64)> {
        let Self { noise, levels, scores, .. } = self;
        let (mut slope, mut pull) = (&scores.squares - &scores.expected, DVector::zeros(levels.len()));
        let mut information = scores.information.clone();
        for (i, level) in levels.iter().enumerate() {
            // What no reading shows has neither.
            let towards = scores.squares[i] * (scores.squares[i] / scores.expected[i]).ln();
            pull[i] = if towards.is_finite() { towards } else { 0.0 };
            information[(i, i)] += if level.is_torque() { LEAST_INFORMATION } else { part.known() };
            if !level.is_torque() {
                let of_prior = -part.known() * part.off(*level, noise);
                slope[i] += of_prior;
                pull[i] += of_prior;
            }
        }
        // Far from the top it may lead down where levels do the same; that of the gradient itself never does.
        let by = within(&information, &pull)?;
        let by = if by.dot(&slope) > 0.0 { by } else { within(&information, &slope)? };
        let gain_nats = 0.5 * by.dot(&slope);
        gain_nats.is_finite().then_some((by, gain_nats))
    }
}

/// What the first so many instants of a recording say of its levels, and log p of them; `None` where the motion is lost, or log p is not above `least`.
/// At the last place levels are of no interest any more.
pub(super) fn scored(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    levels: &[Level],
    most: usize,
    least: f64,
    is_last: bool,
) -> Option<(Scores, f64)> {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    if is_last {
        let log = filter.run(most, &mut |_| {}).log;
        return (log > least).then(|| (Scores::none(levels.len()), log));
    }
    let mut likelihood = Likelihood::begun(filter.log_known);
    filter.trail = Some(Trail::new(start.layout));
    let mut scores = Scores::none(levels.len());
    for instants in 1.. {
        let goes_on = instants <= most && filter.step(&mut |innovation| likelihood.add(innovation));
        // It keeps what it was given.
        let trail = filter.trail.as_mut()?;
        if goes_on && !trail.is_full {
            continue;
        }
        if !goes_on {
            likelihood.log += filter.mean.apart.log();
        }
        let is_likelier = likelihood.log > least;
        if !goes_on && (filter.mean.lost || !is_likelier) {
            return None;
        }
        scores.add(trail, levels, noise);
        if !goes_on {
            break;
        }
        trail.begin_next();
    }
    Some((scores, likelihood.log))
}

/// A step that changes no level by more than it may, by further information: Levenberg, *Quarterly of Applied Mathematics* 2 (1944) 164.
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
