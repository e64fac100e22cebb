//! The portmanteau test of Ljung and Box.

use serde::Serialize;
use whorl_math::statistics::{chi_squared_probability, chi_squared_quantile};

use super::autocorrelation;

/// Result of the test that the first autocorrelations are zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LjungBox {
    /// Lags tested.
    pub lags: u32,
    /// Q = n (n + 2) sum r_k^2 / (n - k).
    pub statistic: f64,
    /// 99 % quantile of Q for white residuals.
    pub limit_99: f64,
    /// Probability of a Q this large for white residuals.
    pub p_value: f64,
}

impl LjungBox {
    /// Whether the residuals pass as white.
    #[must_use]
    pub fn is_white(&self) -> bool {
        self.statistic <= self.limit_99
    }
}

/// G. Ljung and G. Box, On a measure of lack of fit in time series models, Biometrika 65 (1978) 297.
///
/// `None` for fewer than twice as many values as lags, or values that do not vary.
#[must_use]
pub fn ljung_box(residual: &[f64], lags: u32) -> Option<LjungBox> {
    let n = residual.len() as f64;
    if lags == 0 || residual.len() < 2 * lags as usize {
        return None;
    }
    let r = autocorrelation(residual, lags as usize)?;
    let sum: f64 = r.iter().enumerate().skip(1).map(|(k, r)| r * r / (n - k as f64)).sum();
    let statistic = n * (n + 2.0) * sum;
    Some(LjungBox {
        lags,
        statistic,
        limit_99: chi_squared_quantile(0.99, lags),
        p_value: (1.0 - chi_squared_probability(statistic, lags)).clamp(0.0, 1.0),
    })
}
