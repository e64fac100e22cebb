//! Predictions ahead: the model alone, from the filtered state, over a horizon.
//!
//! What a prediction from time t errs by follows from what comes in after t: with the true model it is a sum of
//! innovations behind t. Errors at the ends of stretches that follow each other are therefore independent of each other,
//! and their squares over their predicted variances have a chi-squared distribution, in open and in closed loop.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::Plant;

use crate::filter::{Filter, Innovation};
use crate::prepared::Prepared;

/// Predictions over one horizon, stretch after stretch.
pub(crate) struct Ahead {
    horizon_ns: i64,
    stretch: Option<Stretch>,
}

/// A prediction on its way.
struct Stretch {
    plant: Plant,
    event: usize,
    /// Biases as they were; no disturbance.
    beside: DVector<f64>,
    /// Covariance at its start, without the disturbance, and the motion of errors since.
    covariance: DMatrix<f64>,
    transition: DMatrix<f64>,
    from_ns: i64,
}

/// The error of a prediction ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AheadError {
    /// Instant, component, sample, error and its predicted deviation; NaN where the horizon is not reached.
    pub error: Innovation,
    /// What was read, in the channel's unit; of a direction NaN.
    pub reading: f64,
    /// Whether it is the sensor's last reading within the horizon.
    pub is_at_horizon: bool,
}

impl Ahead {
    /// Over this time \[s\].
    pub fn new(horizon_s: f64) -> Self {
        Self { horizon_ns: whorl_trajectory::commands::ns(horizon_s).max(1), stretch: None }
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
        if now_ns > end_ns || !case.run_to(&mut stretch.plant, &mut stretch.event, now_ns) {
            // Lost, or due to begin anew.
            self.stretch = None;
            return;
        }
        stretch.transition = &filter.transition * &stretch.transition;
        for row in filter.rows_of(&stretch.plant, &stretch.beside, due) {
            let track = case.tracks().get(row.track);
            let following = track.and_then(|track| track.instant_ns(row.sample + 1));
            let is_at_horizon = following.is_some_and(|next_ns| next_ns > end_ns);
            let mut variance = f64::NAN;
            if is_at_horizon {
                variance = stretch.variance(filter, &row.by_state, (now_ns - stretch.from_ns) as f64 * 1e-9)
                    + row.variance;
            }
            told(&AheadError {
                error: Innovation {
                    time_s: now_ns as f64 * 1e-9,
                    component: row.component,
                    sample: row.sample,
                    value: row.value,
                    stddev: variance.sqrt(),
                },
                reading: row.reading,
                is_at_horizon,
            });
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
        let mut covariance = filter.covariance.clone();
        let mut beside = filter.beside.clone();
        let mut plant = filter.plant.clone();
        plant.set_disturbance(Vector3::zeros(), 0.0);
        for i in layout.disturbance() {
            beside[i] = 0.0;
            covariance.row_mut(i).fill(0.0);
            covariance.column_mut(i).fill(0.0);
        }
        self.stretch = Some(Stretch {
            plant,
            event: filter.event,
            beside,
            covariance,
            transition: DMatrix::identity(layout.moving(), layout.moving()),
            from_ns: now_ns,
        });
    }
}

impl Stretch {
    /// Variance of what these derivatives show, after so long \[s\].
    fn variance(&self, filter: &Filter<'_>, by_state: &DVector<f64>, after_s: f64) -> f64 {
        let (m, n) = (filter.layout.moving(), filter.layout.size());
        let mut at_start = by_state.clone();
        let moved = self.transition.transpose() * by_state.rows(0, m);
        at_start.rows_mut(0, m).copy_from(&moved);
        let grown: f64 = (0..n).map(|i| filter.walk_variance(i, after_s) * by_state[i].powi(2)).sum();
        at_start.dot(&(&self.covariance * &at_start)) + grown
    }
}
