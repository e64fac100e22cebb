//! Does the error of a filter match its covariance? NEES, NIS and their chi-squared bands.
//!
//! Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, Wiley, 2001, section 5.4.

use nalgebra::{SMatrix, SVector};
use whorl_math::statistics::chi_squared_quantile;

/// Normalised estimation error squared `e^T P^-1 e`; `None` if `P` is not positive definite.
#[must_use]
pub fn nees<const N: usize>(error: &SVector<f64, N>, covariance: &SMatrix<f64, N, N>) -> Option<f64> {
    let factor = covariance.cholesky()?;
    Some(error.dot(&factor.solve(error)))
}

/// Two-sided band that the average of `runs` independent NEES (or NIS) values of `dof` degrees of
/// freedom keeps with the given probability.
#[must_use]
pub fn average_band(dof: u32, runs: u32, probability: f64) -> (f64, f64) {
    let total = dof.saturating_mul(runs);
    let tail = 0.5 * (1.0 - probability);
    let scale = f64::from(runs.max(1));
    (chi_squared_quantile(tail, total) / scale, chi_squared_quantile(1.0 - tail, total) / scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    #[test]
    fn bands_match_published_figures() {
        // 6 states: 100 runs [5.34, 6.70], 1000 runs [5.79, 6.22].
        for (runs, low, high) in [(100, 5.34, 6.70), (1000, 5.79, 6.22)] {
            let band = average_band(6, runs, 0.95);
            assert!((band.0 - low).abs() < 0.006 && (band.1 - high).abs() < 0.006, "{band:?}");
        }
    }

    #[test]
    fn nees_of_a_known_case() {
        let covariance = Matrix2::new(4.0, 0.0, 0.0, 0.25);
        assert_eq!(nees(&Vector2::new(2.0, 1.0), &covariance), Some(5.0));
        assert_eq!(nees(&Vector2::new(2.0, 1.0), &-covariance), None);
    }
}
