//! How noisy the readings are, and how large what pushes the platform besides its model: levels that the run shows. Log p has a gradient by each and an
//! information ([`scores`]), and steps of all at once lead to the top ([`climb`]), from torques of the likeliest of sizes that are decades apart.

mod climb;
mod scores;

#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_math::covariance::narrowed;
use whorl_math::statistics::{chi_squared_quantile, normal_probability};
use whorl_recording::{Channel, Recording};

use crate::filter::Filter;
use crate::fitted::{LARGEST_MISFIT, fitted_start_near, fitted_start_within};
use crate::readings::{SHARE_OF_MOTION_RAD, SHARE_OF_TIME, Track};
use crate::start::fastest_change;
use crate::within::{SHARE_OF_LOOP_RAD, loop_rate_1_s};
use crate::{
    Disturbance, FittedStart, Likelihood, Noise, PredictionError, Prepared, RandomTorque, Settings, Start,
};

use climb::climb;

/// Sizes of torques that levels begin with, each a tenth of the one before: from the fastest motion within a second to far below a sensor's noise.
const SIZES: i32 = 7;
/// Parts of a run over which levels are found, each so many times as long as the one before.
const LONGER: usize = 6;
/// Random torques about each axis.
const PROCESSES: usize = 3;
/// Disturbances are surely there if they make a run likelier by so many times what they must.
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
    pub fn log_likelihood(&self) -> f64 {
        let gained = if self.noise.disturbance.is_some() { self.gain_nats } else { 0.0 };
        self.undisturbed_likelihood.log + gained
    }

    /// What the levels of its random torques cost log evidence, `level_seen_nats` each: that they are as likely as can be was not known before.
    pub fn levels_nats(&self, settings: &Settings) -> f64 {
        settings.level_seen_nats * self.noise.disturbance.count() as f64
    }

    /// Whether its starts have the states of the model of a case: of a model with others nothing can be taken over.
    pub fn is_of(&self, case: &Prepared<'_>) -> bool {
        self.fitted.start.is_of(case) && self.undisturbed.start.is_of(case)
    }

    /// The same by the model without disturbances.
    pub fn without_disturbance(&self) -> Self {
        let (noise, fitted) = (self.undisturbed_noise(), self.undisturbed.clone());
        Self { noise, fitted, gain_nats: 0.0, ..self.clone() }
    }

    /// The noise without disturbances.
    pub fn undisturbed_noise(&self) -> Noise {
        Noise { disturbance: Disturbance::NONE, ..self.noise.clone() }
    }
}

/// The same run with another disturbance, as a filter would begin: for passes that ask what more there is.
pub fn followed_with(case: &Prepared<'_>, followed: &Followed, disturbance: Disturbance) -> Followed {
    let noise = Noise { disturbance, ..followed.noise.clone() };
    let start = followed.fitted.start.with_levels(case, &noise);
    let fitted = FittedStart { covariance: start.covariance.clone(), start, ..followed.fitted.clone() };
    Followed { noise, fitted, ..followed.clone() }
}

/// Follows a run with the levels that it shows, beginning with the stated ones: by the first part of it, of torques of all sizes the likeliest, from there
/// the likeliest levels, and with these the start; then by longer and longer parts.
pub fn follow(case: &Prepared<'_>, stated: &Noise) -> Followed {
    follow_anew(case, stated, Fit::None)
}

pub(crate) fn follow_anew(case: &Prepared<'_>, stated: &Noise, fit: Fit) -> Followed {
    let settings = case.settings();
    let part = settings.level_first_instants;
    let start_by = |noise: &Noise| fitted_start_within(case, noise, settings.level_start_instants);
    let loud = Noise { disturbance: first_guess(case), ..stated.clone() };
    let start = start_by(&loud).start;
    let tried = (0..SIZES).map(|k| {
        let mut noise = loud.clone();
        noise.disturbance.stddevs_n_m_mut().for_each(|stddev| *stddev *= 0.1_f64.powi(k));
        let start = start.with_levels(case, &noise);
        let log = Filter::new(case, &noise, &start).about_known_biases(&start).run(part, &mut |_| {}).log;
        (log, noise)
    });
    let best = tried.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(loud, |(_, noise)| noise);
    let noise = climb(case, stated, best.clone(), &start, Some(part), fit).map_or(best, |found| found.noise);
    followed_by(case, stated, noise, fit)
}

/// Follows a run beginning with the levels that other runs of the same platform show.
pub fn follow_like(case: &Prepared<'_>, stated: &Noise, mut noise: Noise) -> Followed {
    if !case.reads(Channel::WheelSpeed) {
        noise.disturbance.motors_n_m.clear();
    }
    followed_by(case, stated, noise, Fit::None)
}

fn followed_by(case: &Prepared<'_>, stated: &Noise, noise: Noise, fit: Fit) -> Followed {
    let settings = case.settings();
    let fitted = fitted_start_within(case, &noise, settings.level_start_instants);
    let longer = settings.level_first_instants.saturating_mul(LONGER);
    judged(case, found(case, stated, spread(case, noise), fitted, longer, fit), None, true)
}

/// The same levels and start, with what the model without disturbances makes of the run, and without these where they are not needed.
pub(crate) fn follow_without(case: &Prepared<'_>, of: &Followed) -> Followed {
    let log = of.log_likelihood();
    judged(case, Found { noise: of.noise.clone(), fitted: of.fitted.clone(), log }, Some(of), true)
}

/// The same with a model close to the one with which the run was followed before, or better: where that one needed no disturbances, this one does not.
pub fn follow_again(case: &Prepared<'_>, stated: &Noise, before: &Followed) -> Followed {
    followed_from(case, stated, before, Fit::None)
}

/// Where a fit is.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Fit {
    /// Values stand.
    None,
    /// The same; what the model without disturbances makes of a run is asked for at the end alone, by [`follow_without`].
    Judged,
    /// With levels of another model: torques of all correlation times are tried again, of which those that a worse one had hidden may show by now.
    Begun,
    /// Values still move. What the model without disturbances makes of a run is asked for at the end alone: before, what was known of it stands.
    OnWay,
}

pub(crate) fn followed_from(case: &Prepared<'_>, stated: &Noise, before: &Followed, fit: Fit) -> Followed {
    if !before.fitted.start.is_of(case) {
        return follow_anew(case, stated, fit);
    }
    if before.noise.disturbance.is_some() {
        return judged(case, found_again(case, stated, before, fit), Some(before), fit == Fit::None);
    }
    let (noise, fitted) = (before.noise.clone(), &before.fitted);
    let noise =
        climb(case, stated, noise.clone(), &fitted.start, None, fit).map_or(noise, |found| found.noise);
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &noise, fitted);
    Followed { noise, fitted: undisturbed.clone(), undisturbed, undisturbed_likelihood, gain_nats: 0.0 }
}

/// The same noise with torques of all correlation times.
fn spread(case: &Prepared<'_>, noise: Noise) -> Noise {
    Noise { disturbance: noise.disturbance.spread(times_s(case)), ..noise }
}

/// Correlation times of torques that come and go within a run: one that stays is a constant of the model, and one that is gone at the next reading does not show.
fn times_s<'a>(case: &'a Prepared<'_>) -> &'a [f64] {
    let times_s = &case.settings().disturbance_correlations_s;
    let duration_s = case.recording().duration_s();
    let sample_s = duration_s / case.instants().max(1) as f64;
    let shorter_than = |limit_s: f64| times_s.iter().take_while(|time_s| **time_s < limit_s).count();
    // One there is in any case: the longest of a rig that is read once a minute, the shortest of a run of a blink.
    let first = shorter_than(sample_s).min(times_s.len() - 1);
    let last = shorter_than(duration_s).max(first + 1);
    &times_s[first.max(last.saturating_sub(PROCESSES))..last]
}

/// The longest [`Settings::cell_s`] up to that of the settings \[s\]: a quarter of a radian of the fastest motion, a tenth of one of a controller, and a
/// sixth of the shortest time of a random torque that the recordings show. None where only wheels move: their friction holds them and lets go between readings.
///
/// # Errors
/// See [`PredictionError`].
pub fn longest_cell_s(
    recordings: &[Recording],
    model: &PlatformModel,
    settings: &Settings,
) -> Result<f64, PredictionError> {
    recordings.iter().try_fold(settings.cell_s, |longest_s, recording| {
        let case = Prepared::new(recording, model, Settings { cell_s: 0.0, ..*settings })?;
        let shortest_s = times_s(&case).iter().copied().fold(f64::INFINITY, f64::min);
        let of_motion_s = SHARE_OF_MOTION_RAD / case.fastest_1_s.max(1e-9);
        let of_loop_s = SHARE_OF_LOOP_RAD / loop_rate_1_s(&case).max(1e-9);
        let longest_s = longest_s.min(SHARE_OF_TIME * shortest_s).min(of_motion_s).min(of_loop_s);
        // Two readings at least.
        let of_track = |track: &Track<'_>| recording.duration_s() / track.time_s.len().max(1) as f64;
        let sample_s = case.tracks.iter().map(of_track).fold(f64::INFINITY, f64::min);
        Ok(if case.clamped || longest_s < 2.0 * sample_s { 0.0 } else { longest_s })
    })
}

struct Found {
    noise: Noise,
    fitted: FittedStart,
    /// log p of the run; where its motion is lost, minus infinity.
    log: f64,
}

/// The likeliest levels of a run, from those that were found with a model close by.
fn found_again(case: &Prepared<'_>, stated: &Noise, before: &Followed, fit: Fit) -> Found {
    let (mut noise, mut fitted) = (before.noise.clone(), before.fitted.clone());
    // As narrow as the run makes it by now: log p depends on that.
    let wide = Start::wide(case, &noise).covariance;
    fitted.start.covariance = narrowed(&wide, &fitted.covariance, case.settings().start_kept);
    if fit == Fit::Begun {
        noise = spread(case, noise);
    }
    found(case, stated, noise, fitted, case.instants(), fit)
}

/// The same from these levels on, by longer and longer parts of the run from one of so many instants.
fn found(
    case: &Prepared<'_>,
    stated: &Noise,
    mut noise: Noise,
    mut fitted: FittedStart,
    mut part: usize,
    fit: Fit,
) -> Found {
    loop {
        // What a climb takes over a third of it, some three passes, is one over the whole.
        let first = Some(part).filter(|part| *part < case.instants() / 3);
        let Some(found) = climb(case, stated, noise.clone(), &fitted.start, first, fit) else {
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

/// With disturbances if these make the run likelier by what they must; `before`: a model close by, of which what it makes of the run without them
/// is enough, if they surely do and it is not asked `anew`.
fn judged(
    case: &Prepared<'_>,
    Found { noise, fitted, log }: Found,
    before: Option<&Followed>,
    anew: bool,
) -> Followed {
    let is_disturbed = noise.disturbance.is_some();
    let needed = by_chance_nats(noise.disturbance.count(), case.settings().level_needed_deviations);
    if let Some(before) = before.filter(|_| is_disturbed && !anew) {
        let gain_nats = log - before.undisturbed_likelihood.log;
        if gain_nats > SURELY * needed {
            return Followed { noise, fitted, gain_nats, ..before.clone() };
        }
    }
    let without = Noise { disturbance: Disturbance::NONE, ..noise.clone() };
    // From where it began before, if that was close.
    let close = before.filter(|before| before.undisturbed_likelihood.misfit() < LARGEST_MISFIT);
    let near = close.map_or(&fitted, |before| &before.undisturbed);
    let (undisturbed, undisturbed_likelihood) = fitted_start_near(case, &without, near);
    let gain_nats = log - undisturbed_likelihood.log;
    let is_needed = gain_nats > needed && is_disturbed;
    let (noise, fitted) = if is_needed { (noise, fitted) } else { (without, undisturbed.clone()) };
    Followed { noise, fitted, undisturbed, undisturbed_likelihood, gain_nats }
}

/// By how much more parameters make data likelier that need none of them, at so many deviations of a normal variable.
fn by_chance_nats(parameters: usize, deviations: f64) -> f64 {
    0.5 * chi_squared_quantile(normal_probability(deviations), parameters.max(1) as u32)
}

/// Torques so large that they make the fastest motion of the run within a second.
fn first_guess(case: &Prepared<'_>) -> Disturbance {
    let (body, wheels) = fastest_change(case);
    let of_time = |tau_s: &f64| RandomTorque { stddev_b_n_m: [body; 3], correlation_s: *tau_s };
    Disturbance {
        body: times_s(case).iter().map(of_time).collect(),
        // Where no speed is a reading, no motor shows.
        motors_n_m: if case.reads(Channel::WheelSpeed) { wheels } else { Vec::new() },
        motors_correlation_s: case.settings().motors_correlation_s,
    }
}
