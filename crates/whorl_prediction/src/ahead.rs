//! Predictions ahead: the model alone, from the filtered state, over a horizon.
//!
//! What a prediction from time t errs by follows from what comes in after t: with the true model it is a sum of
//! innovations behind t. Errors at the ends of stretches that follow each other are therefore independent of each other,
//! and their squares over their predicted variances have a chi-squared distribution, in open and in closed loop.

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::Plant;

use crate::claims::Claims;
use crate::filter::Filter;
use crate::innovations::{Innovation, Mean};
use crate::lanes::{Lanes, dot};
use crate::prepared::Prepared;
use crate::rows::{Readings, Row};

/// Predictions over one horizon, stretch after stretch.
pub(crate) struct Ahead {
    horizon_ns: i64,
    /// Every reading on the way is told, not only those at the horizon.
    is_shown: bool,
    stretch: Option<Stretch>,
}

/// A prediction on its way.
struct Stretch {
    plant: Plant,
    event: usize,
    /// Biases as they were; no disturbance.
    beside: DVector<f64>,
    /// Covariance at its start as the model alone claims it, the motion of errors since, and what random torques have added.
    covariance: DMatrix<f64>,
    transition: Lanes,
    noise: Option<Lanes>,
    from_ns: i64,
}

/// The error of a prediction ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AheadError {
    /// Instant, component, sample, error and its deviation as the model alone claims it, without disturbances.
    pub error: Innovation,
    /// What was read, in the channel's unit; of a direction NaN.
    pub reading: f64,
    /// Whether it is the sensor's last reading within the horizon.
    pub is_at_horizon: bool,
}

impl AheadError {
    /// Of a reading at this instant \[ns\], whose error has this variance.
    pub(crate) fn of(row: &Row, at_ns: i64, variance: f64, is_at_horizon: bool) -> Self {
        let error = Innovation {
            time_s: at_ns as f64 * 1e-9,
            component: row.component,
            sample: row.sample,
            value: row.value,
            stddev: variance.sqrt(),
        };
        Self { error, reading: row.reading, is_at_horizon }
    }
}

impl Ahead {
    /// Over this time \[s\].
    pub fn new(horizon_s: f64, is_shown: bool) -> Self {
        let horizon_ns = crate::inputs::commands::ns(horizon_s).max(1);
        Self { horizon_ns, is_shown, stretch: None }
    }

    /// A filter has gone to the next instant and not yet taken in what is due there.
    pub fn follow(
        &mut self,
        case: &Prepared<'_>,
        filter: &Filter<'_>,
        readings: &mut Readings,
        told: &mut dyn FnMut(&AheadError),
    ) {
        let Some(stretch) = &mut self.stretch else { return };
        let (mean, gains) = (&filter.mean, &filter.gains);
        let now_ns = mean.plant.now_ns();
        let end_ns = stretch.from_ns + self.horizon_ns;
        if now_ns > end_ns {
            self.stretch = None;
            return;
        }
        if let Some(claims) = &gains.claims {
            stretch.carry(claims);
        }
        let is_at_horizon = |track: usize, sample: usize| {
            let following = case.tracks().get(track).and_then(|track| track.instant_ns(sample + 1));
            following.is_some_and(|next_ns| next_ns > end_ns)
        };
        if !(self.is_shown || mean.due.iter().any(|(track, sample)| is_at_horizon(*track, *sample))) {
            return;
        }
        if !case.run_to(&mut stretch.plant, &mut stretch.event, now_ns) {
            self.stretch = None;
            return;
        }
        stretch.plant.average_readings(case.mean_inputs(now_ns));
        mean.read_of(&stretch.plant, stretch.beside.as_slice(), Some(&gains.linearised), readings);
        for (r, row) in readings.rows.iter().enumerate() {
            let is_at_horizon = is_at_horizon(row.track, row.sample);
            if !(self.is_shown || is_at_horizon) {
                continue;
            }
            let after_s = (now_ns - stretch.from_ns) as f64 * 1e-9;
            let of_state = stretch.variance(mean, readings.by_state.row(r), after_s);
            let variance = of_state + readings.variances[r];
            told(&AheadError::of(row, now_ns, variance, is_at_horizon));
        }
    }

    /// A filter has taken in what was due: begins where the last prediction has ended.
    pub fn begin(&mut self, filter: &Filter<'_>) {
        let mean = &filter.mean;
        let now_ns = mean.plant.now_ns();
        // The next stretch begins with the first reading that is not before the end of this one.
        if self.stretch.as_ref().is_some_and(|stretch| now_ns < stretch.from_ns + self.horizon_ns) {
            return;
        }
        let layout = mean.layout;
        let mut beside = mean.beside.clone();
        let mut plant = mean.plant.clone();
        plant.clear_disturbances();
        beside.rows_range_mut(layout.plant.size()..layout.moving()).fill(0.0);
        self.stretch = Some(Stretch {
            plant,
            event: mean.event,
            beside,
            covariance: filter.claimed(),
            transition: Lanes::identity(layout.moving(), layout.size()),
            noise: filter.has_own_noise().then(|| Lanes::zeros(layout.moving(), layout.size())),
            from_ns: now_ns,
        });
    }
}

impl Stretch {
    /// Carries errors on to where the filter is.
    fn carry(&mut self, claims: &Claims) {
        self.transition.carry(&claims.transition);
        if let Some(noise) = &mut self.noise {
            noise.grow(&claims.transition, claims.noise.as_ref());
        }
    }

    /// Variance of what these derivatives show, after so long \[s\].
    fn variance(&self, mean: &Mean<'_>, by_state: &[(usize, f64)], after_s: f64) -> f64 {
        let moving = self.transition.rows();
        let mut at_start = DVector::zeros(self.covariance.nrows());
        let (mut walked, mut random) = (0.0, 0.0);
        for (i, by) in by_state {
            if *i >= moving {
                at_start[*i] += by;
                walked += mean.case.walk_variance(mean.layout, *i, after_s) * by.powi(2);
                continue;
            }
            at_start.iter_mut().zip(self.transition.row(*i)).for_each(|(at, through)| *at += by * through);
            random += self
                .noise
                .as_ref()
                .map_or(0.0, |noise| by * dot(by_state_of(by_state, moving), noise.row(*i)));
        }
        at_start.dot(&(&self.covariance * &at_start)) + random + walked
    }
}

/// The part of a row that moves.
fn by_state_of(row: &[(usize, f64)], moving: usize) -> &[(usize, f64)] {
    &row[..row.partition_point(|(i, _)| *i < moving)]
}
