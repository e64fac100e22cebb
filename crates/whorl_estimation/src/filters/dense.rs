//! The Kalman filter's two steps with dense matrices of any size, for the filters that are compared.

use nalgebra::{Const, SMatrix, SVector};

/// `P <- F P F^T + Q` (eq. 4.45, discrete).
pub(super) fn propagate<const N: usize>(
    p: &mut SMatrix<f64, N, N>,
    f: &SMatrix<f64, N, N>,
    q: &SMatrix<f64, N, N>,
) {
    *p = f * *p * f.transpose() + q;
    *p = (*p + p.transpose()) * 0.5;
}

/// Measurement update (eqs. 4.50-4.53) with Joseph's form: the correction and the normalised innovation squared. `None`,
/// and nothing changed, if the innovation's covariance is not positive definite.
pub(super) fn update<const N: usize, const M: usize>(
    p: &mut SMatrix<f64, N, N>,
    h: &SMatrix<f64, M, N>,
    noise: &SMatrix<f64, M, M>,
    innovation: &SVector<f64, M>,
) -> Option<(SVector<f64, N>, f64)>
where
    Const<M>: nalgebra::DimMin<Const<M>, Output = Const<M>>,
{
    let on = *p * h.transpose();
    let s = (h * on + noise).cholesky()?;
    let gain = s.solve(&on.transpose()).transpose();
    let keep = SMatrix::<f64, N, N>::identity() - gain * h;
    *p = keep * *p * keep.transpose() + gain * noise * gain.transpose();
    *p = (*p + p.transpose()) * 0.5;
    Some((gain * innovation, innovation.dot(&s.solve(innovation))))
}
