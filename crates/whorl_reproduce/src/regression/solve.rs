//! Solutions of a p = b.

use nalgebra::{DMatrix, DVector, SMatrix};
use thiserror::Error;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector};

use super::rows::System;
use crate::prepared::DataError;

/// How equations are weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Weighting {
    /// Eq. 4.78.
    PseudoInverse,
    /// Weighted least squares: the error of the integrated rows is a constant (the first rate's) and white
    /// noise of each row's own rate, with this standard deviation of the right-hand side per axis; the
    /// constants are estimated along.
    Markov {
        /// Standard deviation of the rows' error about each body axis.
        row_stddev: [f64; 3],
    },
    /// Noise of the rate in the matrix, of this standard deviation [rad/s], is taken into account.
    TotalLeastSquares {
        /// Standard deviation of the rate in the matrix [rad/s].
        rate_stddev_rad_s: f64,
    },
}

/// Why there is no solution.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RegressionError {
    /// The recording cannot be used.
    #[error(transparent)]
    Data(#[from] DataError),
    /// Too few equations.
    #[error("{rows} equations for nine parameters: the run is too short")]
    TooFewRows {
        /// Equations given.
        rows: usize,
    },
    /// Values that are not finite.
    #[error("the estimated motion holds numbers that are not finite")]
    NotFinite,
    /// The matrix less its noise is not positive definite.
    #[error(
        "the noise of the rate explains all of the motion in some direction: that parameter was not excited"
    )]
    NoiseExplainsAll,
}

/// A solution.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The nine parameters.
    pub estimate: MassVector,
    /// Covariance from the scatter of the residuals, which treats them as independent: too small for
    /// integrated rows.
    pub covariance: MassCovariance,
    /// Singular values of the matrix with columns scaled to unit length, descending.
    pub singular_values: MassVector,
    /// Right singular vectors of the same.
    pub combinations: MassCovariance,
    /// Root mean square of the residuals.
    pub residual_rms: f64,
}

/// Solves the equations.
///
/// # Errors
/// [`RegressionError`].
pub fn solve(system: &System, weighting: Weighting) -> Result<Solution, RegressionError> {
    let (a, b) = (&system.matrix, &system.right);
    if a.nrows() <= MASS_PARAMETERS {
        return Err(RegressionError::TooFewRows { rows: a.nrows() });
    }
    if !a.iter().chain(b.iter()).all(|x| x.is_finite()) {
        return Err(RegressionError::NotFinite);
    }
    let (normal, right) = match weighting {
        Weighting::Markov { row_stddev } => markov(a, b, row_stddev),
        Weighting::TotalLeastSquares { .. } if system.common_start => markov(a, b, [1.0; 3]),
        _ => (a.tr_mul(a), a.tr_mul(b)),
    };
    let mut information = MassCovariance::from_fn(|i, j| normal[(i, j)]);
    let right = MassVector::from_fn(|i, _| right[i]);
    if let Weighting::TotalLeastSquares { rate_stddev_rad_s } = weighting {
        information -= system.noise_product * rate_stddev_rad_s.powi(2);
        if !scaled(&information).symmetric_eigenvalues().iter().all(|e| *e > 1e-12) {
            return Err(RegressionError::NoiseExplainsAll);
        }
    }
    // Nine orders of magnitude between columns: scaled, then by the pseudo-inverse as printed.
    let scale = information.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let svd = nalgebra::SVD::new(scaled(&information), true, true);
    let largest = svd.singular_values.max();
    let inverse = svd.pseudo_inverse(1e-14 * largest).map_err(|_| RegressionError::NotFinite)?;
    let estimate = (inverse * right.component_mul(&scale)).component_mul(&scale);
    let x = DVector::from_column_slice(estimate.as_slice());
    let residual = b - a * x;
    let variance = residual.norm_squared() / (a.nrows() - MASS_PARAMETERS) as f64;
    let unit = SMatrix::from_diagonal(&scale);
    let mut order: Vec<usize> = (0..MASS_PARAMETERS).collect();
    order.sort_by(|i, j| svd.singular_values[*j].total_cmp(&svd.singular_values[*i]));
    let mut singular_values = MassVector::zeros();
    let mut combinations = MassCovariance::zeros();
    for (to, from) in order.into_iter().enumerate() {
        singular_values[to] = svd.singular_values[from].max(0.0).sqrt();
        if let Some(u) = &svd.u {
            combinations.set_column(to, &u.column(from));
        }
    }
    Ok(Solution {
        estimate,
        covariance: unit * inverse * unit * variance,
        singular_values,
        combinations,
        residual_rms: (residual.norm_squared() / a.nrows() as f64).sqrt(),
    })
}

fn scaled(information: &MassCovariance) -> MassCovariance {
    let scale = information.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let unit = SMatrix::from_diagonal(&scale);
    let product = unit * information * unit;
    0.5 * (product + product.transpose())
}

/// Normal equations with weights per axis and the three constants eliminated.
fn markov(a: &DMatrix<f64>, b: &DVector<f64>, row_stddev: [f64; 3]) -> (DMatrix<f64>, DVector<f64>) {
    let mut normal = DMatrix::zeros(MASS_PARAMETERS, MASS_PARAMETERS);
    let mut right = DVector::zeros(MASS_PARAMETERS);
    for (axis, stddev) in row_stddev.into_iter().enumerate() {
        let weight = stddev.max(1e-12).powi(-2);
        let index: Vec<usize> = (axis..a.nrows()).step_by(3).collect();
        let count = index.len().max(1) as f64;
        let rows = a.select_rows(&index);
        let values = DVector::from_iterator(index.len(), index.iter().map(|i| b[*i]));
        // Eliminating a constant is the same as subtracting the means.
        let mean = rows.row_mean();
        let centred = DMatrix::from_fn(rows.nrows(), rows.ncols(), |i, j| rows[(i, j)] - mean[j]);
        let offset = values.sum() / count;
        normal += centred.tr_mul(&centred) * weight;
        right += centred.tr_mul(&values.map(|v| v - offset)) * weight;
    }
    (normal, right)
}
