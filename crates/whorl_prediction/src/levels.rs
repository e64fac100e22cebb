//! How noisy the readings are, and how large what pushes the platform besides its model: levels that the run shows.
//!
//! With the levels of a stationary process, an estimate's squares and its variance add up to the process's own variance. A pass
//! of the filter therefore changes all levels at once, and of all passes the likeliest counts.

use std::collections::BTreeMap;

use nalgebra::DVector;
use whorl_recording::{Channel, Component};

use crate::filter::Filter;
use crate::fitted::{FittedStart, fitted_start_near, fitted_start_within};
use crate::guess::fastest_change;
use crate::innovations::Innovation;
use crate::layout::Layout;
use crate::likelihood::Likelihood;
use crate::noise::{Disturbance, Noise, RandomTorque};
use crate::prepared::Prepared;
use crate::start::Start;

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
    let (mut log, noise) = best.unwrap_or_else(|| (f64::NEG_INFINITY, stated.clone()));
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
        body: vec![RandomTorque {
            stddev_b_n_m: [body; 3],
            correlation_s: case.settings().disturbance_correlation_s,
        }],
        motors_n_m: if shown { wheels } else { Vec::new() },
        motors_correlation_s: case.settings().disturbance_correlation_s,
    }
}

/// Whether no level changes by more than a share.
pub(crate) fn stands(now: &Noise, next: &Noise, share: f64) -> bool {
    let levels = |noise: &Noise| -> Vec<f64> {
        let body = noise.disturbance.body.iter().flat_map(|of| &of.stddev_b_n_m);
        let of = body.chain(&noise.disturbance.motors_n_m);
        let readings = noise.gyro_rad_s.iter().chain(&noise.force_m_s2).chain(&noise.vector_rad);
        of.chain(readings).chain([&noise.wheel_speed_rad_s]).copied().collect()
    };
    levels(now).iter().zip(levels(next)).all(|(now, next)| (next - now).abs() <= share * now)
}

/// What a pass shows of the levels.
struct Moments {
    log: f64,
    layout: Layout,
    /// Of each coordinate over time: square of the estimate, and variance.
    estimate: DVector<f64>,
    variance: DVector<f64>,
    time_s: f64,
    /// Of each sensor's component: squares of the readings' own errors.
    readings: BTreeMap<Component, Squares>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Squares {
    squares: f64,
    numbers: usize,
}

impl Moments {
    fn of(case: &Prepared<'_>, noise: &Noise, start: &Start, part: usize) -> Self {
        let mut filter = Filter::new(case, noise, start).about_known_biases(start);
        let layout = start.layout;
        let mut found = Self {
            log: filter.log_known,
            layout,
            estimate: DVector::zeros(layout.size()),
            variance: DVector::zeros(layout.size()),
            time_s: 0.0,
            readings: BTreeMap::new(),
        };
        let mut last_ns = filter.mean.plant.now_ns();
        for _ in 0..part {
            let mut add = |innovation: &Innovation| {
                found.log += innovation.log_likelihood();
                let own = noise.of(innovation.component).powi(2);
                // What the innovation says of the reading's own error, and how uncertain that is: EM of a variance.
                let sums = found.readings.entry(pooled(innovation.component)).or_default();
                let share = own / innovation.stddev.powi(2);
                sums.squares += own + own * share * (innovation.normalised().powi(2) - 1.0);
                sums.numbers += 1;
            };
            if !filter.step(&mut add) {
                break;
            }
            let since_s = (filter.mean.plant.now_ns() - last_ns) as f64 * 1e-9;
            last_ns = filter.mean.plant.now_ns();
            for i in layout.plant.size()..layout.moving() {
                found.estimate[i] += filter.mean.beside[i].powi(2) * since_s;
                found.variance[i] += filter.gains.covariance.row(i)[i] * since_s;
            }
            found.time_s += since_s;
        }
        if filter.is_lost() {
            found.log = f64::NEG_INFINITY;
        }
        found
    }

    /// Levels that agree better with what was found.
    fn improved(&self, case: &Prepared<'_>, noise: &Noise, stated: &Noise) -> Noise {
        let settings = case.settings();
        let mut next = noise.clone();
        let (body, motors) = (self.layout.disturbance(), self.layout.motors());
        let level = |i: usize, stddev: f64| {
            let (variance, time_s) = (stddev * stddev, self.time_s);
            let seen = 1.0 - self.variance[i] / time_s / variance;
            if !(variance > 0.0 && seen > settings.level_seen) {
                return 0.0;
            }
            // Exact where the disturbance is seen well, slow where it is hardly: steps are as much longer.
            let ratio = self.estimate[i] / time_s / variance / seen;
            stddev * ratio.powf(0.5 * (1.0 / seen).min(settings.level_longest_step)).clamp(0.01, 100.0)
        };
        let processes =
            next.disturbance.body.iter_mut().filter(|of| of.stddev_b_n_m.iter().any(|x| *x > 0.0));
        for (i, stddev) in body.zip(processes.flat_map(|of| &mut of.stddev_b_n_m)) {
            *stddev = level(i, *stddev);
        }
        for (i, stddev) in motors.zip(&mut next.disturbance.motors_n_m) {
            *stddev = level(i, *stddev);
        }
        for (component, sums) in &self.readings {
            let stated = stated.of(*component);
            let found = (sums.squares / sums.numbers as f64).sqrt();
            // The stated level counts as some readings more.
            let prior = 0.5 * settings.stated_noise_factor.ln().powi(-2);
            let share = sums.numbers as f64 / (sums.numbers as f64 + prior);
            next.set(*component, stated * (found / stated).powf(share));
        }
        next
    }
}

/// Components that share a level, by the first of them: the axes across a direction; all tachometers.
fn pooled(component: Component) -> Component {
    match component.channel {
        Channel::Vector | Channel::WheelSpeed => Component::new(component.channel, component.sensor(), 0),
        _ => component,
    }
}
