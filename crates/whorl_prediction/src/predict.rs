//! A recording predicted from beginning to end.

use nalgebra::DVector;
use whorl_dynamics::Plant;

use crate::commands::ns;
use crate::filter::Filter;
use crate::rows::{Readings, Row};
use crate::{FittedStart, Innovation, Likelihood, Noise, Prepared, Start};

/// What is told while a recording is predicted, in the order of the instants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Told<'a> {
    /// A reading less its prediction from everything before.
    Innovation(&'a Innovation),
    /// A reading less its prediction over a horizon, by its position.
    Ahead(usize, &'a AheadError),
}

/// Predicts a recording: each reading from everything before it, and over these horizons \[s\] by the model alone. Of the last
/// horizon every reading on the way is told, of the others those at the horizon.
pub fn predict(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    horizons_s: &[f64],
    told: &mut dyn FnMut(Told<'_>),
) -> Likelihood {
    let mut sums = Likelihood::default();
    let mut filter = Filter::new(case, noise, start);
    filter.gains.claim(horizons_s.len());
    let ahead = |(position, horizon_s): (usize, &f64)| Ahead {
        position,
        horizon_ns: ns(*horizon_s).max(1),
        is_shown: position + 1 == horizons_s.len(),
        end_ns: i64::MIN,
        plant: filter.mean.plant.clone(),
        event: 0,
        beside: start.beside.clone(),
    };
    let mut aheads: Vec<Ahead> = horizons_s.iter().enumerate().map(ahead).collect();
    let mut readings = Readings::default();
    while filter.go() {
        for (position, ahead) in aheads.iter_mut().enumerate() {
            ahead.follow(&filter, &mut readings, &mut |error| told(Told::Ahead(position, error)));
        }
        filter.read();
        filter.take_in(&mut |innovation| {
            sums.add(innovation);
            told(Told::Innovation(innovation));
        });
        if filter.mean.lost {
            break;
        }
        aheads.iter_mut().for_each(|ahead| ahead.begin(&mut filter));
    }
    sums.lost = filter.mean.lost;
    sums
}

/// What the model alone says of a whole recording from its fitted start, with the deviations that it claims. False where the motion is lost on the way.
pub fn simulate(
    case: &Prepared<'_>,
    noise: &Noise,
    fitted: &FittedStart,
    told: &mut dyn FnMut(&AheadError),
) -> bool {
    let start = Start { covariance: fitted.covariance.clone(), ..fitted.start.clone() };
    let mut filter = Filter::new(case, noise, &start);
    while filter.go() {
        filter.read();
        let (readings, covariance) = (&filter.readings, &filter.gains.covariance);
        for (r, row) in readings.rows.iter().enumerate() {
            let variance = covariance.variance(readings.by_state.row(r)) + readings.variances[r];
            told(&AheadError::of(row, filter.mean.plant.now_ns(), variance, false));
        }
    }
    !filter.mean.lost
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
    fn of(row: &Row, at_ns: i64, variance: f64, is_at_horizon: bool) -> Self {
        let Row { component, sample, value, reading, .. } = *row;
        let error =
            Innovation { time_s: at_ns as f64 * 1e-9, component, sample, value, stddev: variance.sqrt() };
        Self { error, reading, is_at_horizon }
    }
}

/// Predictions ahead by the model alone, one stretch behind the other.
struct Ahead {
    /// Of the covariances that go along ([`crate::gains::Gains::ahead`]).
    position: usize,
    horizon_ns: i64,
    /// Every reading on the way is told, not only those at the horizon.
    is_shown: bool,
    /// Where the present stretch ends; not yet, or its motion is lost: long ago.
    end_ns: i64,
    plant: Plant,
    event: usize,
    /// Biases as they were; no disturbance.
    beside: DVector<f64>,
}

impl Ahead {
    /// A filter has gone to the next instant and not yet taken in what is due there.
    fn follow(&mut self, filter: &Filter<'_>, readings: &mut Readings, told: &mut dyn FnMut(&AheadError)) {
        let (mean, gains, case) = (&filter.mean, &filter.gains, filter.mean.case);
        let (now_ns, end_ns) = (mean.plant.now_ns(), self.end_ns);
        let is_at_horizon = |track: usize, sample: usize| {
            let following = case.tracks.get(track).and_then(|track| track.instant_ns(sample + 1));
            following.is_some_and(|next_ns| next_ns > end_ns)
        };
        let is_asked = self.is_shown || mean.due.iter().any(|(track, sample)| is_at_horizon(*track, *sample));
        if now_ns > end_ns || !is_asked {
            return;
        }
        if !case.commands.run_to(&mut self.plant, &mut self.event, now_ns) {
            self.end_ns = i64::MIN;
            return;
        }
        self.plant.average_readings(case.mean_inputs(now_ns));
        mean.read_of(&self.plant, &self.beside, Some(&gains.linearised), readings);
        for (r, row) in readings.rows.iter().enumerate() {
            let is_at_horizon = is_at_horizon(row.track, row.sample);
            if self.is_shown || is_at_horizon {
                let of_state = gains.ahead[self.position].variance(readings.by_state.row(r));
                told(&AheadError::of(row, now_ns, of_state + readings.variances[r], is_at_horizon));
            }
        }
    }

    /// A filter has taken in what was due: the next stretch begins with the first reading that is not before the end of this one.
    fn begin(&mut self, filter: &mut Filter<'_>) {
        let Filter { mean, gains, .. } = filter;
        let (now_ns, layout) = (mean.plant.now_ns(), mean.layout);
        if now_ns < self.end_ns {
            return;
        }
        self.plant.clone_from(&mean.plant);
        self.plant.clear_disturbances();
        self.beside.copy_from(&mean.beside);
        self.beside.rows_range_mut(layout.plant.size()..layout.moving()).fill(0.0);
        (self.event, self.end_ns) = (mean.event, now_ns + self.horizon_ns);
        gains.begin_ahead(self.position);
    }
}
