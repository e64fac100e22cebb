//! Least squares with a prior, whether residuals are as large as the noise says, and what that means for deviations.

use nalgebra::{SMatrix, SVector};
use whorl_math::statistics::chi_squared_quantile;
use whorl_recording::Finding;

use crate::PerAxis;

/// A fit is bad when residuals as large as these are as rare as this.
const RARE: f64 = 1e-3;
/// An uncertainty above this share of the prior's is "not determined".
const DETERMINED: f64 = 0.2;
/// Steps at most, the step of numerical derivatives, and the step that is none.
const ROUNDS: usize = 20;
const STEP: f64 = 1e-6;
const NO_STEP: f64 = 1e-12;

/// Unknowns, three by three of a kind, with their covariance.
pub(super) struct Fitted<const N: usize> {
    pub at: SVector<f64, N>,
    covariance: SMatrix<f64, N, N>,
    prior: SVector<f64, N>,
    pub misfit: Misfit,
}

/// Gauss and Newton's least squares of residuals of M numbers, one of each of the data, of which `free` are free in all, with prior
/// standard deviations about zero. A residual is over its standard deviation: of the unknowns given first with that at those given
/// second, about which it is linearised. `None` where they are not finite.
pub(super) fn fit<D, const N: usize, const M: usize>(
    prior: SVector<f64, N>,
    data: &[D],
    free: f64,
    residual: impl Fn(&D, &SVector<f64, N>, &SVector<f64, N>) -> SVector<f64, M>,
) -> Option<Fitted<N>> {
    let of_prior = SMatrix::<f64, N, N>::from_diagonal(&prior.map(|stddev| stddev.powi(-2)));
    let mut at = SVector::<f64, N>::zeros();
    let mut information = of_prior;
    for _ in 0..ROUNDS {
        information = of_prior;
        let mut right = -of_prior * at;
        for datum in data {
            let here = residual(datum, &at, &at);
            let mut slopes = SMatrix::<f64, M, N>::zeros();
            for n in 0..N {
                let mut moved = at;
                moved[n] += STEP;
                slopes.set_column(n, &((residual(datum, &moved, &at) - here) / STEP));
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
    // How many unknowns the data determine: the rest is the prior's.
    let used = (covariance * (information - of_prior)).trace();
    let squares = data.iter().map(|datum| residual(datum, &at, &at).norm_squared());
    let misfit = Misfit { chi_squared: squares.sum(), dof: free - used };
    let inflation = misfit.ratio().map_or(1.0, |ratio| ratio.powi(2).max(1.0));
    Some(Fitted { at, covariance: covariance * inflation, prior, misfit })
}

impl<const N: usize> Fitted<N> {
    /// Three of the unknowns, those that the data determine.
    pub fn three(&self, first: usize) -> PerAxis {
        let mut found = PerAxis::default();
        for axis in 0..3 {
            let n = first + axis;
            let stddev = self.covariance[(n, n)].sqrt();
            if stddev < DETERMINED * self.prior[n] {
                found.set(axis, self.at[n], stddev);
            }
        }
        found
    }
}

/// Sum of squared residuals over their variances, and the residuals that are free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// Sum of squares \[1\].
    pub chi_squared: f64,
    /// Residuals less the unknowns that they determine \[1\].
    pub dof: f64,
}

impl Misfit {
    /// Residuals over what their noise explains, root mean square \[1\]; `None` where none are free.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        (self.dof > 0.5).then(|| (self.chi_squared / self.dof).sqrt())
    }

    /// Whether the noise explains the residuals; `None` where none are free.
    #[must_use]
    pub fn fits(&self) -> Option<bool> {
        let dof = self.dof.round();
        (dof >= 1.0).then(|| self.chi_squared < chi_squared_quantile(1.0 - RARE, dof as u32))
    }

    /// The test in words; `what` describes the residuals.
    pub(super) fn finding(&self, sensor: &str, what: &str) -> Option<Finding> {
        let ratio = self.ratio().filter(|_| self.fits() == Some(false))?;
        Some(Finding::warning(format!(
            "The data do not fit the model of the {sensor}: it leaves {what} {ratio:.1} times what the noise explains ({:.0} degrees of \
             freedom). All its deviations were multiplied by {ratio:.1}. Was it touched or warmed while it lay, or is something else \
             wrong with it?",
            self.dof
        )))
    }
}
