//! How likely a recording is.

use serde::Serialize;

use crate::filter::Innovation;

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
    pub(crate) fn add(&mut self, innovation: &Innovation) {
        self.log += innovation.log_likelihood();
        self.chi_squared += innovation.normalised().powi(2);
        self.numbers += 1;
    }
}
