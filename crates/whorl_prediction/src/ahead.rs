//! Predictions ahead: the model alone, from the filtered state, over a horizon.
//!
//! What a prediction from time t errs by follows from what comes in after t: with the true model it is a sum of
//! innovations behind t. Errors at the ends of stretches that follow each other are therefore independent of each other,
//! and their squares over their predicted variances have a chi-squared distribution, in open and in closed loop.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::Plant;

use crate::claims::Claims;
use crate::filter::{Filter, Innovation};
use crate::prepared::Prepared;
use crate::rows::Row;

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
    transition: DMatrix<f64>,
    noise: Option<DMatrix<f64>>,
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
        let horizon_ns = whorl_trajectory::commands::ns(horizon_s).max(1);
        Self { horizon_ns, is_shown, stretch: None }
    }

    /// A filter has gone to the next instant and not yet taken in what is due there.
    pub fn follow(
        &mut self,
        case: &Prepared<'_>,
        filter: &Filter<'_>,
        due: &[(usize, usize)],
        told: &mut dyn FnMut(&AheadError),
    ) {
        let Some(stretch) = &mut self.stretch else { return };
        let now_ns = filter.plant.now_ns();
        let end_ns = stretch.from_ns + self.horizon_ns;
        if now_ns > end_ns {
            self.stretch = None;
            return;
        }
        if let Some(claims) = &filter.claims {
            stretch.carry(claims);
        }
        let is_at_horizon = |track: usize, sample: usize| {
            let following = case.tracks().get(track).and_then(|track| track.instant_ns(sample + 1));
            following.is_some_and(|next_ns| next_ns > end_ns)
        };
        if !(self.is_shown || due.iter().any(|(track, sample)| is_at_horizon(*track, *sample))) {
            return;
        }
        if !case.run_to(&mut stretch.plant, &mut stretch.event, now_ns) {
            self.stretch = None;
            return;
        }
        stretch.plant.average_readings(case.mean_inputs(now_ns));
        for row in filter.rows_of(&stretch.plant, &stretch.beside, due) {
            let is_at_horizon = is_at_horizon(row.track, row.sample);
            if !(self.is_shown || is_at_horizon) {
                continue;
            }
            let after_s = (now_ns - stretch.from_ns) as f64 * 1e-9;
            let variance = stretch.variance(filter, &row.by_state, after_s) + row.variance;
            told(&AheadError::of(&row, now_ns, variance, is_at_horizon));
        }
    }

    /// A filter has taken in what was due: begins where the last prediction has ended.
    pub fn begin(&mut self, filter: &Filter<'_>) {
        let now_ns = filter.plant.now_ns();
        // The next stretch begins with the first reading that is not before the end of this one.
        if self.stretch.as_ref().is_some_and(|stretch| now_ns < stretch.from_ns + self.horizon_ns) {
            return;
        }
        let layout = filter.layout;
        let mut beside = filter.beside.clone();
        let mut plant = filter.plant.clone();
        plant.set_disturbance(Vector3::zeros(), 0.0);
        beside.rows_range_mut(layout.plant.size()..layout.moving()).fill(0.0);
        self.stretch = Some(Stretch {
            plant,
            event: filter.event,
            beside,
            covariance: filter.claimed().clone(),
            transition: DMatrix::identity(layout.moving(), layout.moving()),
            noise: filter.has_own_noise().then(|| DMatrix::zeros(layout.moving(), layout.moving())),
            from_ns: now_ns,
        });
    }
}

impl Stretch {
    /// Carries errors on to where the filter is.
    fn carry(&mut self, claims: &Claims) {
        self.transition = &claims.transition * &self.transition;
        if let Some((noise, added)) = self.noise.as_mut().zip(claims.noise.as_ref()) {
            *noise = &claims.transition * &*noise * claims.transition.transpose() + added;
        }
    }

    /// Variance of what these derivatives show, after so long \[s\].
    fn variance(&self, filter: &Filter<'_>, by_state: &DVector<f64>, after_s: f64) -> f64 {
        let (m, n) = (filter.layout.moving(), filter.layout.size());
        let mut at_start = by_state.clone();
        at_start.rows_mut(0, m).gemv_tr(1.0, &self.transition, &by_state.rows(0, m), 0.0);
        let walked: f64 = (m..n).map(|i| filter.walk_variance(i, after_s) * by_state[i].powi(2)).sum();
        let now = by_state.rows(0, m);
        let random = self.noise.as_ref().map_or(0.0, |noise| now.dot(&(noise * now)));
        at_start.dot(&(&self.covariance * &at_start)) + random + walked
    }
}
