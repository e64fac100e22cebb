//! How noisy the readings are, and how large what pushes the platform besides its model: levels that the run shows.
//!
//! They are parameters as others are: log p has a gradient by each and an information ([`scores`]), and steps of all at once lead to
//! the top ([`climb`]), from torques of the likeliest of sizes that are decades apart.

mod climb;
mod scores;

#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_math::statistics::{chi_squared_quantile, normal_probability};
use whorl_recording::{Channel, Recording};

use crate::cells::{SHARE_OF_MOTION_RAD, SHARE_OF_TIME};
use crate::filter::{Filter, Likelihood};
use crate::fitted::{FittedStart, fitted_start_near, fitted_start_within};
use crate::noise::{Disturbance, Noise, RandomTorque};
use crate::passes::narrowed;
use crate::prepared::Prepared;
use crate::refusal::PredictionError;
use crate::settings::Settings;
use crate::start::Start;
use crate::start::fastest_change;

use climb::climb;

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

    /// Whether its starts have the states of the model of a case: of a model with others nothing can be taken over.
    #[must_use]
    pub fn is_of(&self, case: &Prepared<'_>) -> bool {
        self.fitted.start.is_of(case) && self.undisturbed.start.is_of(case)
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

/// Follows a run with the levels that it shows, beginning with the stated ones: by the first part of it, of torques of all sizes the likeliest, from there
/// the likeliest levels, and with these the start; then by longer and longer parts.
#[must_use]
pub fn follow(case: &Prepared<'_>, stated: &Noise) -> Followed {
    let settings = case.settings();
    let part = settings.level_first_instants;
    let start_by = |noise: &Noise| fitted_start_within(case, noise, settings.level_start_instants);
    let loud = Noise { disturbance: first_guess(case), ..stated.clone() };
    let start = start_by(&loud).start;
    let sizes =
        (0..SIZES).map(|k| Noise { disturbance: loud.disturbance.scaled(0.1_f64.powi(k)), ..loud.clone() });
    let log = |noise: &Noise| {
        let start = start.with_levels(case, noise);
        Filter::new(case, noise, &start).about_known_biases(&start).run(part, &mut |_| {}).log
    };
    let tried = sizes.map(|noise| (log(&noise), noise));
    let best = tried.max_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(|| loud.clone(), |(_, noise)| noise);
    let noise = climb(case, stated, best.clone(), &start, Some(part)).map_or(best, |found| found.noise);
    let fitted = start_by(&noise);
    judged(case, found(case, stated, spread(case, noise), fitted, part.saturating_mul(LONGER)), None)
}

/// The same with a model close by, or a better one, than the one with which the run was followed before: where that one needed no disturbances, this one
/// does not.
#[must_use]
pub fn follow_again(case: &Prepared<'_>, stated: &Noise, before: &Followed) -> Followed {
    followed_from(case, stated, before, false)
}

/// The same; on the way of a fit the model without disturbances is asked for at its end alone: while it is far from explaining the run, what was known
/// of it before stands.
pub(crate) fn followed_from(
    case: &Prepared<'_>,
    stated: &Noise,
    before: &Followed,
    is_on_way: bool,
) -> Followed {
    if !before.fitted.start.is_of(case) {
        return follow(case, stated);
    }
    if before.noise.disturbance.is_some() {
        return judged(case, found_again(case, stated, before), is_on_way.then_some(before));
    }
    let (noise, fitted) = (before.noise.clone(), &before.fitted);
    let noise = climb(case, stated, noise.clone(), &fitted.start, None).map_or(noise, |found| found.noise);
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &noise, fitted, f64::NEG_INFINITY);
    Followed { noise, fitted: undisturbed.clone(), undisturbed, undisturbed_likelihood, gain_nats: 0.0 }
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

/// The longest time of which readings may be taken in together, [`Settings::cell_s`], up to that of the settings \[s\]: a quarter of a radian of the fastest
/// motion, and a sixth of the shortest time of a random torque that the recordings show. None where only wheels move: their friction holds them and lets go between one reading
/// and the next.
///
/// # Errors
/// See [`PredictionError`].
pub fn longest_cell_s(
    recordings: &[Recording],
    model: &PlatformModel,
    settings: &Settings,
) -> Result<f64, PredictionError> {
    let each = Settings { cell_s: 0.0, ..*settings };
    recordings.iter().try_fold(settings.cell_s, |longest_s, recording| {
        let case = Prepared::new(recording, model, each)?;
        if case.clamped {
            return Ok(0.0);
        }
        let shortest_s = times_s(&case).iter().copied().fold(f64::INFINITY, f64::min);
        Ok(longest_s.min(SHARE_OF_TIME * shortest_s).min(SHARE_OF_MOTION_RAD / case.fastest_1_s.max(1e-9)))
    })
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
        // Of half of it the other half is soon looked at as well.
        let first = Some(part).filter(|part| *part < case.instants().div_ceil(2));
        let Some(found) = climb(case, stated, noise.clone(), &fitted.start, first) else {
            return Found { noise, fitted, log: f64::NEG_INFINITY };
        };
        if found.start.layout != fitted.start.layout {
            fitted.covariance = found.start.embedded(&fitted.covariance, fitted.start.layout);
        }
        (noise, fitted.start) = (found.noise, found.start);
        if first.is_none() {
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

/// By how much more parameters make data likelier that need none of them, at so many deviations of a normal variable.
fn by_chance_nats(parameters: usize, deviations: f64) -> f64 {
    0.5 * chi_squared_quantile(normal_probability(deviations), parameters.max(1) as u32)
}

/// Torques so large that they make the fastest motion of the run within a second.
fn first_guess(case: &Prepared<'_>) -> Disturbance {
    let (body, wheels) = fastest_change(case);
    // Where no speed is a reading, no motor shows.
    let shown = case.tracks.iter().any(|track| track.channel == Channel::WheelSpeed);
    let of_time =
        |correlation_s: &f64| RandomTorque { stddev_b_n_m: [body; 3], correlation_s: *correlation_s };
    Disturbance {
        body: times_s(case).iter().map(of_time).collect(),
        motors_n_m: if shown { wheels } else { Vec::new() },
        motors_correlation_s: case.settings().motors_correlation_s,
    }
}
