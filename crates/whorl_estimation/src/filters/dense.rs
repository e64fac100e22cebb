//! The Kalman filter's two steps with dense matrices of any size, for the filters that are compared.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::Update;

/// `P <- F P F^T + Q` (eq. 4.45, discrete).
pub(super) fn propagate<const N: usize>(
    p: &mut SMatrix<f64, N, N>,
    f: &SMatrix<f64, N, N>,
    q: &SMatrix<f64, N, N>,
) {
    *p = f * *p * f.transpose() + q;
    *p = (*p + p.transpose()) * 0.5;
}

/// Measurement update (eqs. 4.50-4.53) with Joseph's form, by three components of equal and independent noise of which
/// `dof` are independent of one another: the correction, and how well the innovation agreed. No correction, and
/// nothing changed, if the innovation's covariance is not positive definite.
pub(super) fn update<const N: usize>(
    p: &mut SMatrix<f64, N, N>,
    h: &SMatrix<f64, 3, N>,
    variance: f64,
    innovation: &Vector3<f64>,
    dof: u8,
) -> (SVector<f64, N>, Update) {
    let on = *p * h.transpose();
    let Some(s) = (h * on + Matrix3::identity() * variance).cholesky() else {
        return (SVector::zeros(), Update::default());
    };
    let gain = s.solve(&on.transpose()).transpose();
    let keep = SMatrix::<f64, N, N>::identity() - gain * h;
    *p = keep * *p * keep.transpose() + gain * gain.transpose() * variance;
    *p = (*p + p.transpose()) * 0.5;
    let nis = innovation.dot(&s.solve(innovation));
    (gain * innovation, Update { nis, dof })
}
