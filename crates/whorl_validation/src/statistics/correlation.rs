//! Auto- and cross-correlation.

use serde::Serialize;
use whorl_math::statistics::normal_quantile;

use super::NORMAL_99;

/// Correlation of a residual with an input at lags -n..n.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CrossCorrelation {
    /// Lag: the residual comes this many samples after the input.
    pub lag: Vec<i64>,
    /// Correlation at each lag.
    pub value: Vec<f64>,
    /// 99 % band of each value for unrelated series, one of them white: 2.58 / sqrt(n).
    pub band_99: f64,
    /// 99 % band of the largest of all tested values (Bonferroni).
    pub joint_band_99: f64,
}

impl CrossCorrelation {
    /// The value of largest magnitude, and its lag; `causal`: among lags >= 0 only, which is necessary where a controller
    /// turns measurement noise into later inputs.
    #[must_use]
    pub fn largest(&self, causal: bool) -> Option<(i64, f64)> {
        let all = self.lag.iter().copied().zip(self.value.iter().copied());
        all.filter(|(lag, _)| !causal || *lag >= 0).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
    }

    /// Whether the correlation is significant.
    #[must_use]
    pub fn is_significant(&self, causal: bool) -> bool {
        self.largest(causal).is_some_and(|(_, value)| value.abs() > self.joint_band_99)
    }
}

/// Autocorrelations at lags 0..=`lags` about the mean; `None` for values that do not vary.
#[must_use]
pub fn autocorrelation(values: &[f64], lags: usize) -> Option<Vec<f64>> {
    let centred = centred(values);
    let power: f64 = centred.iter().map(|x| x * x).sum();
    if !(power > 0.0 && power.is_finite()) {
        return None;
    }
    let at = |k: usize| {
        let later = centred.get(k..).unwrap_or(&[]);
        centred.iter().zip(later).map(|(a, b)| a * b).sum::<f64>() / power
    };
    Some((0..=lags).map(at).collect())
}

/// Correlation of `residual` with `input`; `None` if one of them does not vary or their lengths differ.
#[must_use]
pub fn cross_correlation(residual: &[f64], input: &[f64], lags: usize) -> Option<CrossCorrelation> {
    if residual.len() != input.len() || residual.len() <= 2 * lags {
        return None;
    }
    let (e, u) = (centred(residual), centred(input));
    let scale = (e.iter().map(|x| x * x).sum::<f64>() * u.iter().map(|x| x * x).sum::<f64>()).sqrt();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let shifted = |early: &[f64], late: &[f64], lag: usize| -> f64 {
        early.iter().zip(late.get(lag..).unwrap_or(&[])).map(|(a, b)| a * b).sum::<f64>() / scale
    };
    let most = lags as i64;
    let lag: Vec<i64> = (-most..=most).collect();
    let value = lag
        .iter()
        .map(|&k| {
            let size = usize::try_from(k.unsigned_abs()).unwrap_or(0);
            if k >= 0 { shifted(&u, &e, size) } else { shifted(&e, &u, size) }
        })
        .collect();
    let root = (residual.len() as f64).sqrt();
    Some(CrossCorrelation {
        band_99: NORMAL_99 / root,
        joint_band_99: normal_quantile_99(2 * lags + 1) / root,
        lag,
        value,
    })
}

/// Two-sided normal quantile that the largest of `count` values keeps with 99 %.
fn normal_quantile_99(count: usize) -> f64 {
    normal_quantile(1.0 - 0.005 / count.max(1) as f64)
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|x| x - mean).collect()
}
