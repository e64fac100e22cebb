//! How likely a recording is.

use serde::Serialize;

use crate::filter::Filter;
use crate::innovations::Innovation;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::start::Start;

/// Share by which a variance of readings that was found with another model may be off: levels beside random torques are known to some per cent.
const UNSURE_OF_NOISE: f64 = 0.1;

/// Sums over all innovations of a recording.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
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

impl Likelihood {
    /// Mean square of the normalised innovations: 1 with the true model.
    #[must_use]
    pub fn misfit(&self) -> f64 {
        self.chi_squared / self.numbers.max(1) as f64
    }

    /// Whether no more than noise is left: the misfit is 1 to five deviations of a mean of so many squares, and to what a level of noise
    /// may be off by.
    pub(crate) fn is_noise(&self) -> bool {
        self.misfit() < 1.0 + UNSURE_OF_NOISE + 5.0 * (2.0 / self.numbers.max(1) as f64).sqrt()
    }

    /// Of no readings yet; `log_known`: what they do not say of it.
    pub(crate) fn begun(log_known: f64) -> Self {
        Self { log: log_known, ..Self::default() }
    }

    pub(crate) fn add(&mut self, innovation: &Innovation) {
        self.log += innovation.log_likelihood();
        self.chi_squared += innovation.normalised().powi(2);
        self.numbers += 1;
    }
}

/// How likely a recording is with these levels of noise from a start, by a filter with gains of its own; what was known of the biases
/// before the run stays about none.
#[must_use]
pub fn likelihood(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Likelihood {
    likelihood_within(case, noise, start, usize::MAX)
}

/// The same of the first so many instants.
pub(crate) fn likelihood_within(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    most: usize,
) -> Likelihood {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    let (mut taken, mut sums) = (0, Likelihood::begun(filter.log_known));
    while taken < most && filter.step(&mut |innovation| sums.add(innovation)) {
        taken += 1;
    }
    sums.lost = filter.is_lost();
    sums
}
