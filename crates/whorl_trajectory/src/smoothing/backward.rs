//! One backward step of the Rauch-Tung-Striebel smoother.
//!
//! J. Crassidis and J. Junkins, *Optimal Estimation of Dynamic Systems*, 2nd ed., section 6.2.

use nalgebra::SMatrix;

/// The smoother gain of a step, and the smoothed covariance before the step:
///
/// ```text
/// G = P F^T P_predicted^-1,   P_smoothed = P + G (P_after - P_predicted) G^T
/// ```
///
/// `updated` is the covariance P before the step, `transition` the step's F, `predicted` the predicted covariance
/// after it, `after` the smoothed one after it. `None` if the predicted one is not positive definite.
pub(crate) fn back<const N: usize>(
    updated: &SMatrix<f64, N, N>,
    transition: &SMatrix<f64, N, N>,
    predicted: &SMatrix<f64, N, N>,
    after: &SMatrix<f64, N, N>,
) -> Option<(SMatrix<f64, N, N>, SMatrix<f64, N, N>)> {
    let gain = predicted.cholesky()?.solve(&(transition * updated)).transpose();
    let smoothed = updated + gain * (after - predicted) * gain.transpose();
    Some((gain, (smoothed + smoothed.transpose()) * 0.5))
}
