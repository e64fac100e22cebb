//! Forgetting that stops at what was known before.

use whorl_dynamics::mass_parameters::{MassCovariance, MassVector};

/// P / lambda (eqs. 4.97-4.99), with no variance beyond that of `prior`, standard deviations.
#[must_use]
pub fn forget(covariance: &MassCovariance, prior: &MassVector, lambda: f64) -> MassCovariance {
    let scale = MassVector::from_fn(|i, _| {
        let variance = covariance[(i, i)].max(1e-300);
        (prior[i].powi(2) / variance).clamp(1.0, 1.0 / lambda).sqrt()
    });
    let scale = MassCovariance::from_diagonal(&scale);
    scale * covariance * scale
}
