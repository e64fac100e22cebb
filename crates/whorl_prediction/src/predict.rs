//! A recording predicted from beginning to end.

use serde::Serialize;

use crate::ahead::{Ahead, AheadError};
use crate::filter::{Filter, Innovation};
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::start::Start;

/// What is told while a recording is predicted, in the order of the instants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Told<'a> {
    /// A reading less its prediction from everything before.
    Innovation(&'a Innovation),
    /// A reading less its prediction over a horizon, by its position.
    Ahead(usize, &'a AheadError),
}

/// Sums over all innovations of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Likelihood {
    /// log p of all readings given the commands, -1/2 sum(e^2/S + log 2 pi S).
    pub log: f64,
    /// Sum of squares of the normalised innovations.
    pub chi_squared: f64,
    /// How many numbers were read.
    pub numbers: usize,
    /// The motion was lost before the end: a parameter is too extreme.
    pub lost: bool,
}

/// Predicts a recording: each reading from everything before it, and over these horizons \[s\] by the model alone.
pub fn predict(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    horizons_s: &[f64],
    told: &mut dyn FnMut(Told<'_>),
) -> Likelihood {
    let mut sums = Likelihood { log: 0.0, chi_squared: 0.0, numbers: 0, lost: false };
    let mut filter = Filter::new(case, noise, start);
    let mut aheads: Vec<Ahead> = horizons_s.iter().map(|h| Ahead::new(*h)).collect();
    while let Some(instant_ns) = filter.go() {
        let due = filter.due(instant_ns);
        for (position, ahead) in aheads.iter_mut().enumerate() {
            ahead.follow(case, &filter, &due, &mut |error| told(Told::Ahead(position, error)));
        }
        let rows = filter.rows(&due);
        filter.take_in(&rows, &mut |innovation| {
            sums.log += innovation.log_likelihood();
            sums.chi_squared += innovation.normalised().powi(2);
            sums.numbers += 1;
            told(Told::Innovation(innovation));
        });
        for ahead in &mut aheads {
            ahead.begin(&filter);
        }
    }
    sums.lost = filter.lost;
    sums
}
