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
    /// The part of it that is the model's own, without disturbances.
    pub of_model: Option<DMatrix<f64>>,
}

/// Covariance that a step over `h_s` of dx/dt = A x + G n adds, with independent white noise n of density one and the columns of G in the
/// coordinates' units per root of a second; `None` where nothing is random:
///
/// ```text
/// Q = integral from 0 to h of exp(A s) G G^T exp(A s)^T ds
///   = h D + h^2/2 L D + h^3/6 L (L D) + ...,    D = G G^T,    L X = A X + X A^T
/// ```
pub(crate) fn added(a: &DMatrix<f64>, root: &DMatrix<f64>, h_s: f64) -> Option<DMatrix<f64>> {
    if root.ncols() == 0 {
        return None;
    }
    let n = a.nrows();
    let mut term = DMatrix::zeros(n, n);
    add_product_transposed(&mut term, root, root);
    term *= h_s;
    let (mut sum, mut next) = (term.clone(), DMatrix::zeros(n, n));
    let least = SMALLEST_TERM * sum.amax();
    for k in 2..=MOST_TERMS {
        next.fill(0.0);
        add_product_transposed(&mut next, &term, a);
        let factor = h_s / k as f64;
        for i in 0..n {
            for j in 0..=i {
                let both = factor * (next[(i, j)] + next[(j, i)]);
                term[(i, j)] = both;
                term[(j, i)] = both;
            }
        }
        sum += &term;
        if term.amax() < least {
            break;
        }
    }
    Some(sum)
}

/// exp(A h) of an n x n matrix [1/s] over `h_s`, by its series.
pub(crate) fn transition(a: &DMatrix<f64>, h_s: f64) -> DMatrix<f64> {
    let n = a.nrows();
    // Transposed: (A X)^T = X^T A^T.
    let mut sum = DMatrix::identity(n, n);
    let (mut term, mut next) = (sum.clone(), DMatrix::zeros(n, n));
    for k in 1..=MOST_TERMS {
        next.fill(0.0);
        add_product_transposed(&mut next, &term, a);
        next *= h_s / k as f64;
        std::mem::swap(&mut term, &mut next);
        sum += &term;
        if term.amax() < SMALLEST_TERM {
            break;
        }
    }
    sum.transpose()
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

/// to += A F^T with the first columns of A, as many as F has. Most numbers of a transition are zero, which a product of whole
/// matrices does not know.
pub(crate) fn add_product_transposed(to: &mut DMatrix<f64>, a: &DMatrix<f64>, phi: &DMatrix<f64>) {
    for (k, of_column) in phi.column_iter().enumerate() {
        let from = a.column(k);
        for (i, factor) in of_column.iter().enumerate().filter(|(_, x)| **x != 0.0) {
            to.column_mut(i).axpy(*factor, &from, 1.0);
        }
    }
}
