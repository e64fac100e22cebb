//! How noisy the readings are, and how large what pushes the platform besides its model: levels that the run shows.
//!
//! They are parameters as others are: log p has a gradient by each and an information ([`scores`]), and steps of all at once lead to
//! the top ([`climb`]), from torques of the likeliest of sizes that are decades apart.

mod climb;
mod list;
mod packed;
mod scores;
mod trail;

#[cfg(test)]
mod tests;

use whorl_recording::Channel;

use crate::fitted::{FittedStart, fitted_start_near, fitted_start_within};
use crate::guess::fastest_change;
use crate::known::narrowed;
use crate::likelihood::{Likelihood, likelihood_within};
use crate::noise::{Disturbance, Noise, RandomTorque};
use crate::prepared::Prepared;
use crate::start::Start;

use climb::{Over, climb};
pub(crate) use trail::Trail;

/// Sizes of torques that levels begin with, each a tenth of the one before: from what makes the fastest motion within a second to far below a
/// sensor's noise.
const SIZES: i32 = 7;
/// Parts of a run over which levels are found, each so many times as long as the one before.
const LONGER: usize = 6;
/// Random torques about each axis.
const PROCESSES: usize = 3;
/// What is not seen in a part of a run may show in a longer one: each torque has this share of the largest about its axis again when one begins.
const LEAST_SHARE: f64 = 0.05;
/// Disturbances are surely there if they make a run likelier by so many times what they must: what a fit on its way need not ask again.
const SURELY: f64 = 3.0;

/// A run as its filter follows it best: with the levels that it shows, and the start.
#[derive(Debug, Clone, PartialEq)]
pub struct Followed {
    /// Levels of readings and disturbance.
    pub noise: Noise,
    /// The start with them.
    pub fitted: FittedStart,
    /// The model without disturbances, with the same noise of readings, from the start that it shows.
    pub undisturbed: FittedStart,
    /// How likely it makes the run.
    pub undisturbed_likelihood: Likelihood,
    /// By how much disturbances make the run likelier [natural logarithm].
    pub gain_nats: f64,
}

impl Followed {
    /// log p of the run with these levels [natural logarithm].
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        let gained = if self.noise.disturbance.is_some() { self.gain_nats } else { 0.0 };
        self.undisturbed_likelihood.log + gained
    }

    /// The same by the model without disturbances.
    #[must_use]
    pub fn without_disturbance(&self) -> Self {
        Self {
            noise: self.undisturbed_noise(),
            fitted: self.undisturbed.clone(),
            gain_nats: 0.0,
            ..self.clone()
        }
    }

    /// The noise without disturbances.
    #[must_use]
    pub fn undisturbed_noise(&self) -> Noise {
        Noise { disturbance: Disturbance::NONE, ..self.noise.clone() }
    }
}

/// The same run with another disturbance, as a filter would begin: for passes that ask what more there is.
#[must_use]
pub fn followed_with(case: &Prepared<'_>, followed: &Followed, disturbance: Disturbance) -> Followed {
    let noise = Noise { disturbance, ..followed.noise.clone() };
    let start = followed.fitted.start.with_levels(case, &noise);
    let fitted = FittedStart { covariance: start.covariance.clone(), start, ..followed.fitted.clone() };
    Followed { noise, fitted, ..followed.clone() }
}

/// Follows a run with the levels that it shows, beginning with the stated ones.
#[must_use]
pub fn follow(case: &Prepared<'_>, stated: &Noise) -> Followed {
    let settings = case.settings();
    let loud = Noise { disturbance: first_guess(case), ..stated.clone() };
    let fitted = fitted_start_within(case, &loud, settings.level_start_instants);
    let (noise, fitted) = roughly(case, stated, &loud, fitted);
    let part = settings.level_first_instants.saturating_mul(LONGER);
    judged(case, found(case, stated, noise, fitted, part), None)
}

/// What a fit that ended with this model has handed out of the run; where nobody has, or for a model with other states, it is found.
#[must_use]
pub fn follow_as(case: &Prepared<'_>, stated: &Noise, known: Option<&Followed>) -> Followed {
    let known = known.filter(|known| known.fitted.start.is_of(case) && known.undisturbed.start.is_of(case));
    known.cloned().unwrap_or_else(|| follow(case, stated))
}

/// The same with a model close by, or a better one, than the one with which the run was followed before: where that one needed no disturbances, this one
/// does not.
#[must_use]
pub fn follow_again(case: &Prepared<'_>, stated: &Noise, before: &Followed) -> Followed {
    if !before.fitted.start.is_of(case) {
        return follow(case, stated);
    }
    if before.noise.disturbance.is_some() {
        return judged(case, found_again(case, stated, before), None);
    }
    let (noise, fitted) = (before.noise.clone(), &before.fitted);
    let noise =
        climb(case, stated, noise.clone(), &fitted.start, Over::Run).map_or(noise, |found| found.noise);
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &noise, fitted, f64::NEG_INFINITY);
    Followed { noise, fitted: undisturbed.clone(), undisturbed, undisturbed_likelihood, gain_nats: 0.0 }
}

/// The same on the way of a fit, which asks for the model without disturbances at its end alone: while it is far from explaining the
/// run, what was known of it before stands.
#[must_use]
pub(crate) fn follow_on(case: &Prepared<'_>, stated: &Noise, before: &Followed) -> Followed {
    if !before.fitted.start.is_of(case) || !before.noise.disturbance.is_some() {
        return follow_again(case, stated, before);
    }
    judged(case, found_again(case, stated, before), Some(before))
}

/// The same at the end of a fit: with torques of all correlation times again, of which those that a worse model had hidden may show by now, and with what
/// the model without disturbances makes of the run.
#[must_use]
pub(crate) fn judged_again(case: &Prepared<'_>, stated: &Noise, followed: &Followed) -> Followed {
    if !followed.noise.disturbance.is_some() {
        return followed.clone();
    }
    let before = found_again(case, stated, followed);
    let again =
        found(case, stated, spread(case, before.noise.clone()), before.fitted.clone(), case.instants());
    judged(case, if again.log > before.log { again } else { before }, None)
}

/// The same noise with torques of all correlation times.
fn spread(case: &Prepared<'_>, noise: Noise) -> Noise {
    Noise { disturbance: noise.disturbance.spread(times_s(case), LEAST_SHARE), ..noise }
}

/// Correlation times of torques that come and go within a run: one that stays all along is a constant of the model, and of one that is gone at the next
/// reading no reading tells that it comes and goes.
pub(crate) fn times_s<'a>(case: &'a Prepared<'_>) -> &'a [f64] {
    let times_s = &case.settings().disturbance_correlations_s;
    let duration_s = case.recording().duration_s();
    let sample_s = duration_s / case.instants().max(1) as f64;
    let shorter_than = |limit_s: f64| times_s.iter().take_while(|time_s| **time_s < limit_s).count();
    // One there is in any case: the longest of a rig that is read once a minute, the shortest of a run of a blink.
    let first = shorter_than(sample_s).min(times_s.len() - 1);
    let last = shorter_than(duration_s).max(first + 1);
    &times_s[first.max(last.saturating_sub(PROCESSES))..last]
}

/// Levels and start by the first part of a run: of torques of all sizes the likeliest, from there the likeliest levels, and with these the start.
fn roughly(case: &Prepared<'_>, stated: &Noise, loud: &Noise, fitted: FittedStart) -> (Noise, FittedStart) {
    let settings = case.settings();
    let part = settings.level_first_instants;
    let sizes =
        (0..SIZES).map(|k| Noise { disturbance: loud.disturbance.scaled(0.1_f64.powi(k)), ..loud.clone() });
    let tried = sizes.map(|noise| (log_of(case, &noise, &fitted.start, part), noise));
    let best = tried.max_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(|| loud.clone(), |(_, noise)| noise);
    let over = Over::First(part);
    let noise = climb(case, stated, best.clone(), &fitted.start, over).map_or(best, |found| found.noise);
    let fitted = fitted_start_within(case, &noise, settings.level_start_instants);
    (spread(case, noise), fitted)
}

/// Levels of a run, and the start with them.
struct Found {
    noise: Noise,
    fitted: FittedStart,
    /// log p of the run; where its motion is lost, minus infinity.
    log: f64,
}

/// The likeliest levels of a run, from those that were found with a model close by.
fn found_again(case: &Prepared<'_>, stated: &Noise, before: &Followed) -> Found {
    let (noise, mut fitted) = (before.noise.clone(), before.fitted.clone());
    // As narrow as the run makes it by now: log p depends on that.
    let wide = Start::wide(case, &noise).covariance;
    fitted.start.covariance = narrowed(&wide, &fitted.covariance, case.settings().start_kept);
    found(case, stated, noise, fitted, case.instants())
}

/// The same from these levels on, by longer and longer parts of the run from one of so many instants.
fn found(
    case: &Prepared<'_>,
    stated: &Noise,
    mut noise: Noise,
    mut fitted: FittedStart,
    mut part: usize,
) -> Found {
    loop {
        let over = Over::first(part, case.instants());
        let Some(found) = climb(case, stated, noise.clone(), &fitted.start, over) else {
            return Found { noise, fitted, log: f64::NEG_INFINITY };
        };
        fitted.covariance = found.start.embedded(&fitted.covariance, fitted.start.layout);
        (noise, fitted.start) = (found.noise, found.start);
        if over == Over::Run {
            return Found { noise, fitted, log: found.log };
        }
        noise = spread(case, noise);
        part = part.saturating_mul(LONGER);
    }
}

/// With disturbances if these make the run likelier by what they must.
fn judged(case: &Prepared<'_>, Found { noise, fitted, log }: Found, before: Option<&Followed>) -> Followed {
    let needed = by_chance_nats(noise.disturbance.count(), case.settings().level_needed_deviations);
    let is_sure = |before: &&Followed| {
        noise.disturbance.is_some() && log - before.undisturbed_likelihood.log > SURELY * needed
    };
    if let Some(before) = before.filter(is_sure) {
        let gain_nats = log - before.undisturbed_likelihood.log;
        return Followed { noise, fitted, gain_nats, ..before.clone() };
    }
    let without = Noise { disturbance: Disturbance::NONE, ..noise.clone() };
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &without, &fitted, log);
    let gain_nats = log - undisturbed_likelihood.log;
    let (noise, fitted) = if gain_nats > needed && noise.disturbance.is_some() {
        (noise, fitted)
    } else {
        (without, undisturbed.clone())
    };
    Followed { noise, fitted, undisturbed, undisturbed_likelihood, gain_nats }
}

/// By how much more parameters make data likelier that need none of them, at so many deviations of a normal variable: half a chi-squared variable,
/// whose cube root is nearly normal (E. B. Wilson, M. M. Hilferty, *PNAS* 17 (1931) 684).
fn by_chance_nats(parameters: usize, deviations: f64) -> f64 {
    let degrees = parameters.max(1) as f64;
    let spread = 2.0 / (9.0 * degrees);
    0.5 * degrees * (1.0 - spread + deviations * spread.sqrt()).powi(3)
}

/// log p of the first so many instants of a run.
fn log_of(case: &Prepared<'_>, noise: &Noise, start: &Start, most: usize) -> f64 {
    let found = likelihood_within(case, noise, &start.with_levels(case, noise), most);
    if found.lost || !found.log.is_finite() { f64::NEG_INFINITY } else { found.log }
}

/// Torques so large that they make the fastest motion of the run within a second.
fn first_guess(case: &Prepared<'_>) -> Disturbance {
    let (body, wheels) = fastest_change(case);
    // Where no speed is a reading, no motor shows.
    let shown = case.tracks().iter().any(|track| track.channel == Channel::WheelSpeed);
    let of_time =
        |correlation_s: &f64| RandomTorque { stddev_b_n_m: [body; 3], correlation_s: *correlation_s };
    Disturbance {
        body: times_s(case).iter().map(of_time).collect(),
        motors_n_m: if shown { wheels } else { Vec::new() },
        motors_correlation_s: case.settings().motors_correlation_s,
    }
}
