//! The motion of small errors over a step.

use nalgebra::{DMatrix, DVector};

/// The series ends where a term is below this share of one.
const SMALLEST_TERM: f64 = 1e-13;
/// Terms at most; steps are short against the fastest motion, so that far fewer are needed.
const MOST_TERMS: usize = 30;
/// Products with which the fastest rate is found: its error then is some per cent.
const PRODUCTS: usize = 6;

/// What a step does to errors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Step {
    /// F: an error behind the step by one before it.
    pub transition: DMatrix<f64>,
    /// Covariance that the step adds; `None` where nothing is random.
    pub noise: Option<DMatrix<f64>>,
}

/// A step over `h_s` of dx/dt = A x + white noise with these densities [unit^2/s], by coordinate. The covariance is
/// C. Van Loan's (Computing integrals involving the matrix exponential, IEEE Trans. Automatic Control 23, 1978):
///
/// ```text
/// exp [-A  W ] h = [ .  F^-1 Q ]
///     [ 0  A^T]    [ 0  F^T   ]
/// ```
pub(crate) fn step(a: &DMatrix<f64>, density: &DVector<f64>, h_s: f64) -> Step {
    let n = a.nrows();
    if density.iter().all(|w| *w == 0.0) {
        return Step { transition: transition(a, h_s), noise: None };
    }
    let mut double = DMatrix::zeros(2 * n, 2 * n);
    double.view_mut((0, 0), (n, n)).copy_from(&-a);
    double.view_mut((n, n), (n, n)).copy_from(&a.transpose());
    for (i, w) in density.iter().enumerate() {
        double[(i, n + i)] = *w;
    }
    let both = transition(&double, h_s);
    let f = both.view((n, n), (n, n)).transpose();
    let noise = &f * both.view((0, n), (n, n));
    Step { transition: f, noise: Some(noise) }
}

/// exp(A h) of an n x n matrix [1/s] over `h_s`, by its series.
pub(crate) fn transition(a: &DMatrix<f64>, h_s: f64) -> DMatrix<f64> {
    let n = a.nrows();
    let mut sum = DMatrix::identity(n, n);
    let mut term = sum.clone();
    for k in 1..=MOST_TERMS {
        term = a * &term * (h_s / k as f64);
        sum += &term;
        if term.amax() < SMALLEST_TERM {
            break;
        }
    }
    sum
}

/// The largest size of an eigenvalue, roughly, by powers: whatever the units of the coordinates [1/s].
pub(crate) fn fastest_rate_1_s(a: &DMatrix<f64>) -> f64 {
    let mut v = DVector::from_fn(a.nrows(), |i, _| 1.0 + 0.1 * i as f64);
    let mut fastest: f64 = 0.0;
    for k in 0..PRODUCTS {
        let next = a * &v;
        let (size, before) = (next.norm(), v.norm());
        if !(size > 0.0 && size.is_finite()) {
            break;
        }
        // The first products still show the units of the start.
        if k >= PRODUCTS / 2 {
            fastest = fastest.max(size / before);
        }
        v = next / size;
    }
    fastest
}
