//! How noisy the readings are, and how large what pushes the platform besides its model: levels that the run shows.
//!
//! With the levels of a stationary process, an estimate's squares and its variance add up to the process's own variance. A pass
//! of the filter therefore changes all levels at once, and of all passes the likeliest counts. How fast the torque on the body changes
//! is searched for ([`crate::timing`]): a torque that is taken for a faster one than it is leaves its slow part to other explanations.

use whorl_recording::Channel;

use crate::fitted::{FittedStart, fitted_start_near, fitted_start_within};
use crate::guess::fastest_change;
use crate::likelihood::Likelihood;
use crate::moments::{Moments, stands};
use crate::noise::{Disturbance, Noise};
use crate::prepared::Prepared;
use crate::start::Start;
use crate::timing::timed;

/// Passes in which levels are found once more with another correlation time: they were found with one close by.
const PASSES_WHEN_TIMED: usize = 2;

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
    pub(crate) fn without_disturbance(&self) -> Self {
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

/// Follows a run with the levels that it shows, beginning with the stated ones.
#[must_use]
pub fn follow(case: &Prepared<'_>, stated: &Noise) -> Followed {
    let noise = Noise { disturbance: first_guess(case), ..stated.clone() };
    let fitted = fitted_start_within(case, &noise, case.settings().level_start_instants);
    followed_from(case, stated, noise, fitted, 0)
}

/// The same with a model close by, or a better one, than the one with which the run was followed before: where that one needed no disturbances, this one
/// does not.
#[must_use]
pub fn follow_again(case: &Prepared<'_>, stated: &Noise, before: &Followed) -> Followed {
    if !before.fitted.start.is_of(case) {
        return follow(case, stated);
    }
    if before.noise.disturbance.is_some() {
        let first = case.settings().level_first_passes;
        return followed_from(case, stated, before.noise.clone(), before.fitted.clone(), first);
    }
    let noise = before.noise.clone();
    let moments = Moments::of(case, &noise, &before.fitted.start, case.instants());
    let noise = if moments.log.is_finite() { moments.improved(case, &noise, stated) } else { noise };
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &noise, &before.fitted);
    Followed { noise, fitted: undisturbed.clone(), undisturbed, undisturbed_likelihood, gain_nats: 0.0 }
}

/// Levels from these on, the start known; `first`: passes that have been.
fn followed_from(
    case: &Prepared<'_>,
    stated: &Noise,
    mut noise: Noise,
    mut fitted: FittedStart,
    first: usize,
) -> Followed {
    let settings = case.settings();
    let mut best: Option<(f64, Noise)> = None;
    for pass in first..settings.level_passes {
        // First levels come from the first part of a long run.
        let whole = pass >= settings.level_first_passes || case.instants() <= settings.level_first_instants;
        let part = if whole { case.instants() } else { settings.level_first_instants };
        let moments = Moments::of(case, &noise, &fitted.start.with_disturbance(&noise), part);
        if !moments.log.is_finite() {
            // The motion is lost with such levels: those before it count, or none.
            break;
        }
        let next = moments.improved(case, &noise, stated);
        if !whole {
            noise = next;
            continue;
        }
        let stands = stands(&noise, &next, settings.level_stands);
        let better = best.as_ref().is_none_or(|(log, _)| moments.log > *log);
        if better {
            best = Some((moments.log, noise));
        }
        if stands || !better {
            break;
        }
        noise = next;
    }
    let mut best = best.unwrap_or_else(|| (f64::NEG_INFINITY, stated.clone()));
    if best.1.disturbance.is_of_body() {
        let mut noise = timed(case, stated, &best.1, &fitted.start, first > 0);
        for _ in 0..PASSES_WHEN_TIMED {
            let moments = Moments::of(case, &noise, &fitted.start.with_disturbance(&noise), case.instants());
            if moments.log.is_nan() || moments.log <= best.0 {
                break;
            }
            let next = moments.improved(case, &noise, stated);
            best = (moments.log, std::mem::replace(&mut noise, next));
        }
    }
    let (mut log, noise) = best;
    // Where a kind of disturbance has come to nothing a start has fewer coordinates.
    if Start::wide(case, &noise).layout != fitted.start.layout {
        fitted = fitted_start_within(case, &noise, settings.level_start_instants);
        log = Moments::of(case, &noise, &fitted.start.with_disturbance(&noise), case.instants()).log;
    }
    let start = fitted.start.with_disturbance(&noise);
    let without = Noise { disturbance: Disturbance::NONE, ..noise.clone() };
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &without, &fitted);
    let gain_nats = log - undisturbed_likelihood.log;
    if gain_nats > settings.level_needed_nats && noise.disturbance.is_some() {
        Followed {
            noise,
            fitted: FittedStart { start, ..fitted },
            undisturbed,
            undisturbed_likelihood,
            gain_nats,
        }
    } else {
        Followed {
            noise: without,
            fitted: undisturbed.clone(),
            undisturbed,
            undisturbed_likelihood,
            gain_nats,
        }
    }
}

/// Torques so large that they make the fastest motion of the run within a second.
fn first_guess(case: &Prepared<'_>) -> Disturbance {
    let (body, wheels) = fastest_change(case);
    // Where no speed is a reading, no motor shows.
    let shown = case.tracks().iter().any(|track| track.channel == Channel::WheelSpeed);
    Disturbance {
        stddev_b_n_m: [body; 3],
        motors_n_m: if shown { wheels } else { Vec::new() },
        correlation_s: case.settings().disturbance_correlation_s,
        motors_correlation_s: case.settings().disturbance_correlation_s,
    }
}
