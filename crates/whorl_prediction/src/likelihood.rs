//! How likely a recording is.

use serde::Serialize;

use crate::innovations::Innovation;

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
