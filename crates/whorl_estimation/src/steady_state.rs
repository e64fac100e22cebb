//! The accuracy that an optimal filter settles at.
//!
//! [`farrenkopf`] is the closed form of a single axis at rest: R. L. Farrenkopf, "Analytic
//! steady-state accuracy solutions for two common spacecraft attitude estimators", Journal of
//! Guidance and Control 1(4), 1978, in the form of F. L. Markley and R. G. Reynolds, "Analytic
//! steady-state accuracy of a spacecraft attitude estimator", Journal of Guidance, Control,
//! and Dynamics 23(6), 2000. [`riccati`] iterates the discrete Riccati equation of any time-invariant
//! problem, for example of a spinning body.

use nalgebra::{SMatrix, SVector};

/// Steady-state variances of one axis, before (`minus`) and after (`plus`) an update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Farrenkopf {
    /// Angle variance before an update \[rad^2\].
    pub angle_minus: f64,
    /// Angle variance after an update \[rad^2\].
    pub angle_plus: f64,
    /// Angle-bias covariance before an update \[rad^2/s\].
    pub cross_minus: f64,
    /// Angle-bias covariance after an update \[rad^2/s\].
    pub cross_plus: f64,
    /// Bias variance before an update \[rad^2/s^2\].
    pub bias_minus: f64,
    /// Bias variance after an update \[rad^2/s^2\].
    pub bias_plus: f64,
}

/// Steady state of one axis at rest: gyro white noise `sigma_v` \[rad/sqrt(s)\], bias walk
/// `sigma_u` \[rad/s^1.5\], and an angle measurement of `sigma_n` \[rad\] every `interval_s`.
#[must_use]
pub fn farrenkopf(sigma_v: f64, sigma_u: f64, sigma_n: f64, interval_s: f64) -> Farrenkopf {
    let root = interval_s.sqrt();
    let s_u = sigma_u * interval_s * root / sigma_n;
    let s_v = sigma_v * root / sigma_n;
    let gamma = (1.0 + s_v * s_v / 4.0 + s_u * s_u / 48.0).sqrt();
    let zeta = gamma + s_u / 4.0 + 0.5 * (2.0 * gamma * s_u + s_v * s_v + s_u * s_u / 3.0).sqrt();
    let n2 = sigma_n * sigma_n;
    let middle = sigma_u * sigma_n * (zeta - 1.0 / zeta) / root;
    let half_walk = sigma_u * sigma_u * interval_s / 2.0;
    Farrenkopf {
        angle_minus: n2 * (zeta * zeta - 1.0),
        angle_plus: n2 * (1.0 - 1.0 / (zeta * zeta)),
        cross_minus: -sigma_u * sigma_n * root * zeta,
        cross_plus: -sigma_u * sigma_n * root / zeta,
        bias_minus: middle + half_walk,
        bias_plus: middle - half_walk,
    }
}

/// Covariance after an update in the steady state of `x' = phi x + w`, `z = h x + n`; `None` if
/// 200,000 steps do not settle to a relative 1e-13 or a matrix turns singular.
#[must_use]
pub fn riccati<const N: usize, const M: usize>(
    phi: &SMatrix<f64, N, N>,
    process_noise: &SMatrix<f64, N, N>,
    h: &SMatrix<f64, M, N>,
    noise: &SMatrix<f64, M, M>,
    initial_variance: &SVector<f64, N>,
) -> Option<SMatrix<f64, N, N>> {
    let mut covariance = SMatrix::<f64, N, N>::from_diagonal(initial_variance);
    for _ in 0..200_000 {
        let predicted = phi * covariance * phi.transpose() + process_noise;
        let on = predicted * h.transpose();
        let innovation = h * on + noise;
        let gain = on * innovation.cholesky()?.inverse();
        let keep = SMatrix::<f64, N, N>::identity() - gain * h;
        let updated = keep * predicted * keep.transpose() + gain * noise * gain.transpose();
        let change = (updated - covariance)
            .diagonal()
            .iter()
            .zip(updated.diagonal().iter())
            .fold(0.0_f64, |largest, (d, v)| largest.max((d / v).abs()));
        covariance = updated;
        if change < 1e-13 {
            return Some(covariance);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Matrix1x2, Matrix2, Vector2};

    #[test]
    fn closed_form_equals_the_riccati_iteration() {
        for (sigma_v, sigma_u, sigma_n, t) in
            [(1.7e-4, 1e-5, 3e-3, 0.1), (1e-3, 1e-4, 1e-2, 0.01), (1e-5, 3e-4, 1e-4, 1.0)]
        {
            let phi = Matrix2::new(1.0, -t, 0.0, 1.0);
            let (v2, u2) = (sigma_v * sigma_v, sigma_u * sigma_u);
            let cross = -u2 * t * t / 2.0;
            let q = Matrix2::new(v2 * t + u2 * t * t * t / 3.0, cross, cross, u2 * t);
            let r = Matrix1::new(sigma_n * sigma_n);
            let h = Matrix1x2::new(1.0, 0.0);
            let p = riccati(&phi, &q, &h, &r, &Vector2::new(1.0, 1e-2)).expect("settles");
            let closed = farrenkopf(sigma_v, sigma_u, sigma_n, t);
            let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
            close(closed.angle_plus, p.m11);
            close(closed.cross_plus, p.m12);
            close(closed.bias_plus, p.m22);
            let before = phi * p * phi.transpose() + q;
            close(closed.angle_minus, before.m11);
            close(closed.cross_minus, before.m12);
            close(closed.bias_minus, before.m22);
        }
    }
}
