//! A recording predicted from beginning to end.

use crate::ahead::{Ahead, AheadError};
use crate::filter::Filter;
use crate::fitted::FittedStart;
use crate::innovations::Innovation;
use crate::lanes::dot;
use crate::likelihood::Likelihood;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::start::Start;

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
    if !horizons_s.is_empty() {
        filter = filter.claiming();
    }
    let last = horizons_s.len().saturating_sub(1);
    let mut aheads: Vec<Ahead> =
        horizons_s.iter().enumerate().map(|(k, h)| Ahead::new(*h, k == last)).collect();
    let mut readings = Readings::default();
    while filter.go() {
        for (position, ahead) in aheads.iter_mut().enumerate() {
            ahead.follow(case, &filter, &mut readings, &mut |error| told(Told::Ahead(position, error)));
        }
        filter.read();
        filter.take_in(&mut |innovation| {
            sums.add(innovation);
            told(Told::Innovation(innovation));
        });
        if filter.is_lost() {
            break;
        }
        for ahead in &mut aheads {
            ahead.begin(&filter);
        }
    }
    sums.lost = filter.is_lost();
    sums
}

/// What the model alone says of a whole recording from its fitted start: reading after reading, with the deviations that it
/// claims. False where the motion is lost on the way.
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
            let by_state = readings.by_state.row(r);
            let of_state: f64 = by_state.iter().map(|(i, by)| by * dot(by_state, covariance.row(*i))).sum();
            let variance = of_state + readings.variances[r];
            told(&AheadError::of(row, filter.mean.plant.now_ns(), variance, false));
        }
    }
    !filter.is_lost()
}
