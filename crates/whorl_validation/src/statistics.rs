//! Tests of residuals: are they white?

use serde::Serialize;
use whorl_math::statistics::{chi_squared_probability, chi_squared_quantile};

/// Two-sided 99 % quantile of the standard normal distribution.
pub const NORMAL_99: f64 = 2.575_829_303_548_901;

/// Autocorrelations about the mean at lags 0, 1 and so on; `None` for values that do not vary.
#[must_use]
pub fn autocorrelations(values: &[f64]) -> Option<impl Iterator<Item = f64>> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let centred: Vec<f64> = values.iter().map(|x| x - mean).collect();
    let power: f64 = centred.iter().map(|x| x * x).sum();
    let at = move |k: usize| centred.iter().zip(&centred[k..]).map(|(a, b)| a * b).sum::<f64>() / power;
    (power > 0.0 && power.is_finite()).then(|| (0..values.len()).map(at))
}

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
    let r = autocorrelations(residual)?.take(lags as usize + 1);
    let sum: f64 = r.enumerate().skip(1).map(|(k, r)| r * r / (n - k as f64)).sum();
    let statistic = n * (n + 2.0) * sum;
    Some(LjungBox {
        lags,
        statistic,
        limit_99: chi_squared_quantile(0.99, lags),
        p_value: (1.0 - chi_squared_probability(statistic, lags)).clamp(0.0, 1.0),
    })
}
