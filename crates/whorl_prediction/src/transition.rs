//! The motion of small errors over a step.

use nalgebra::{DMatrix, DVector};

/// The series ends where a term is below this share of one.
const SMALLEST_TERM: f64 = 1e-13;
/// Terms at most; steps are short against the fastest motion, so that far fewer are needed.
const MOST_TERMS: usize = 30;
/// Products with which the fastest rate is found: its error then is some per cent.
const PRODUCTS: usize = 6;

/// Abscissae and weights of Gauss and Legendre on -1 to 1 (Abramowitz and Stegun, *Handbook of Mathematical Functions*, table 25.4).
const GAUSS: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
    (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_9),
];

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
/// ```
///
/// by Gauss and Legendre's rule of four points, exact to the seventh power of A h, which is small.
pub(crate) fn added(a: &DMatrix<f64>, root: DMatrix<f64>, h_s: f64) -> Option<DMatrix<f64>> {
    if root.ncols() == 0 {
        return None;
    }
    // At all points together: the k-th term of each is that at the end times its share of the step to the k-th power.
    let shares = GAUSS.map(|(point, _)| 0.5 * (1.0 + point));
    let mut moved = GAUSS.map(|_| root.clone());
    let mut powers = [1.0; GAUSS.len()];
    terms(a, root, h_s, |term| {
        for ((moved, share), power) in moved.iter_mut().zip(shares).zip(&mut powers) {
            *power *= share;
            moved.zip_apply(term, |x, term| *x += *power * term);
        }
    });
    let mut noise = DMatrix::zeros(a.nrows(), a.nrows());
    for (moved, (_, weight)) in moved.iter().zip(GAUSS) {
        noise.gemm(0.5 * weight * h_s, moved, &moved.transpose(), 1.0);
    }
    Some(noise)
}

/// exp(A h) of an n x n matrix [1/s] over `h_s`, by its series.
pub(crate) fn transition(a: &DMatrix<f64>, h_s: f64) -> DMatrix<f64> {
    let one = DMatrix::identity(a.nrows(), a.nrows());
    let mut sum = one.clone();
    terms(a, one, h_s, |term| sum += term);
    sum
}

/// The terms (A h)^k X / k! of exp(A h) X behind the first.
fn terms(a: &DMatrix<f64>, x: DMatrix<f64>, h_s: f64, mut told: impl FnMut(&DMatrix<f64>)) {
    let least = SMALLEST_TERM * x.amax();
    let (mut term, mut next) = (x.clone(), x);
    for k in 1..=MOST_TERMS {
        next.gemm(h_s / k as f64, a, &term, 0.0);
        std::mem::swap(&mut term, &mut next);
        told(&term);
        if term.amax() < least {
            break;
        }
    }
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
