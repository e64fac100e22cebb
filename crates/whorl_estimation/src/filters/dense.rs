//! Three components of equal and independent noise, for the filters that are compared.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use whorl_math::covariance;

use super::Update;

/// Measurement update (eqs. 4.50-4.53) by three components of which `dof` are independent of one another: the
/// correction, and how well the innovation agreed. No correction, and nothing changed, if the innovation's covariance
/// is not positive definite.
pub(super) fn update<const N: usize>(
    p: &mut SMatrix<f64, N, N>,
    h: &SMatrix<f64, 3, N>,
    variance: f64,
    innovation: &Vector3<f64>,
    dof: u8,
) -> (SVector<f64, N>, Update) {
    match covariance::update(p, h, &(Matrix3::identity() * variance), innovation, |_| true) {
        Some(update) => (update.correction, Update { nis: update.nis, dof }),
        None => (SVector::zeros(), Update::default()),
    }
}
