//! Constants beside a state.

use nalgebra::{DMatrix, DVector};

use super::{Gain, Lanes, Sparse, dot};
use crate::covariance::correct_scalar;

/// What is known of constants b ~ N(0, 1), which change innovations and not the state: B. Friedland, "Treatment of bias in recursive
/// filtering", *IEEE Trans. Automatic Control* 14 (1969) 359. With innovations e over their deviations, and how these change with them, D,
///
/// ```text
/// s = 1 + D P D^T    k = P D^T/s    e' = e - D m    P <- P - k D P    m <- m + k e'
/// ```
///
/// where m is minus their mean, and e'/sqrt(s) is white whatever they are.
#[derive(Debug, Clone)]
pub struct Constants {
    /// P.
    pub covariance: DMatrix<f64>,
    /// D and k of the present instant.
    rows: Sparse,
    gain: Gain,
}

impl Constants {
    /// So many, of which nothing is known but their priors.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { covariance: DMatrix::identity(count, count), rows: Sparse::default(), gain: Gain::default() }
    }

    /// Takes in so many innovations of an instant; `set` sets the entries of a row of D. The constants may have wandered this share of the way back to their
    /// priors since those before.
    pub fn take_in(&mut self, wandered: f64, innovations: usize, set: impl Fn(usize, &mut Sparse)) {
        let count = self.covariance.nrows();
        for i in 0..count {
            self.covariance[(i, i)] += wandered * (1.0 - self.covariance[(i, i)]);
        }
        self.rows.clear();
        self.gain.clear(count);
        let mut across = DVector::zeros(count);
        for r in 0..innovations {
            set(r, &mut self.rows);
            self.rows.end_row();
            let row = self.rows.row(r);
            across.fill(0.0);
            row.iter().for_each(|(k, x)| across.axpy(*x, &self.covariance.column(*k), 1.0));
            let variance = 1.0 + dot(row, across.as_slice());
            let gain = correct_scalar(&mut self.covariance, &across, variance);
            self.gain.push(gain.iter().copied(), row, variance);
        }
    }

    /// Takes them out of innovations, of m or of its sensitivities, which then are over their deviations.
    pub fn take_out(&self, means: &mut Lanes, d: &mut Lanes) {
        means.take_in(&self.rows, &self.gain, d);
        self.gain.normalise(d);
    }
}
