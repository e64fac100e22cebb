//! Least squares with a prior, by Gauss and Newton's steps.

use nalgebra::{SMatrix, SVector};

/// Steps at most, the step of numerical derivatives, and the step that is none.
const ROUNDS: usize = 20;
const STEP: f64 = 1e-6;
const NO_STEP: f64 = 1e-12;

/// Unknowns where the sum of squares is least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeastSquares<const N: usize> {
    /// Their values.
    pub at: SVector<f64, N>,
    /// Their covariance, as the residuals' deviations and the prior say.
    pub covariance: SMatrix<f64, N, N>,
    /// Sum of squares of the residuals.
    pub chi_squared: f64,
    /// How many unknowns the data determine: the rest is the prior's.
    pub determined: f64,
}

/// The unknowns that make residuals of M numbers least, one of each of the data, over their standard deviations. The prior standard deviations of the
/// unknowns are about zero. `None` where they are not finite.
pub fn least_squares<D, const N: usize, const M: usize>(
    prior: SVector<f64, N>,
    data: &[D],
    residual: impl Fn(&D, &SVector<f64, N>) -> SVector<f64, M>,
) -> Option<LeastSquares<N>> {
    let of_prior = SMatrix::<f64, N, N>::from_diagonal(&prior.map(|stddev| stddev.powi(-2)));
    let mut at = SVector::<f64, N>::zeros();
    let mut information = of_prior;
    for _ in 0..ROUNDS {
        information = of_prior;
        let mut right = -of_prior * at;
        for datum in data {
            let here = residual(datum, &at);
            let mut slopes = SMatrix::<f64, M, N>::zeros();
            for n in 0..N {
                let mut moved = at;
                moved[n] += STEP;
                slopes.set_column(n, &((residual(datum, &moved) - here) / STEP));
            }
            information += slopes.transpose() * slopes;
            right -= slopes.transpose() * here;
        }
        let step = information.cholesky()?.solve(&right);
        at += step;
        if step.amax() < NO_STEP {
            break;
        }
    }
    let covariance = information.cholesky()?.inverse();
    let squares = data.iter().map(|datum| residual(datum, &at).norm_squared());
    let determined = (covariance * (information - of_prior)).trace();
    Some(LeastSquares { at, covariance, chi_squared: squares.sum(), determined })
}
