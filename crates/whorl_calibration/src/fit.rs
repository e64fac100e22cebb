//! Whether residuals of a fit are as large as the noise says, and what that means for deviations.

use nalgebra::{SVector, Vector3};
use whorl_math::least_squares::{LeastSquares, least_squares};
use whorl_math::statistics::chi_squared_quantile;
use whorl_recording::Finding;

use crate::PerAxis;

/// A fit is bad when residuals as large as these are as rare as this.
const RARE: f64 = 1e-3;
/// An uncertainty above this share of the prior's is "not determined".
const DETERMINED: f64 = 0.2;

/// Unknowns, three by three of a kind.
pub(super) struct Fitted<const N: usize> {
    found: LeastSquares<N>,
    prior: SVector<f64, N>,
    pub misfit: Misfit,
}

/// Least squares of residuals over their standard deviations, one of each of the data, of which `free` are free in all, with prior standard deviations
/// about zero. `None` where they are not finite.
pub(super) fn fit<D, const N: usize, const M: usize>(
    prior: SVector<f64, N>,
    data: &[D],
    free: f64,
    residual: impl Fn(&D, &SVector<f64, N>) -> SVector<f64, M>,
) -> Option<Fitted<N>> {
    let found = least_squares(prior, data, residual)?;
    let misfit = Misfit { chi_squared: found.chi_squared, dof: free - found.determined };
    Some(Fitted { found, prior, misfit })
}

/// Three of several unknowns.
pub(super) fn three<const N: usize>(unknowns: &SVector<f64, N>, first: usize) -> Vector3<f64> {
    Vector3::from_fn(|i, _| unknowns[first + i])
}

impl<const N: usize> Fitted<N> {
    /// Three of the unknowns, those that the data determine, with deviations that grow with the misfit.
    pub fn three(&self, first: usize) -> PerAxis {
        let inflation = self.misfit.ratio().map_or(1.0, |ratio| ratio.max(1.0));
        let mut found = PerAxis::default();
        for axis in 0..3 {
            let n = first + axis;
            let stddev = self.found.covariance[(n, n)].sqrt() * inflation;
            if stddev < DETERMINED * self.prior[n] {
                found.set(axis, self.found.at[n], stddev);
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
    pub fn ratio(&self) -> Option<f64> {
        (self.dof > 0.5).then(|| (self.chi_squared / self.dof).sqrt())
    }

    /// Whether the noise explains the residuals; `None` where none are free.
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
