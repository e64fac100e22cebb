//! Tests of residuals: are they white, and do they correlate with an input?

use serde::Serialize;
use whorl_math::spectrum::Fourier;
use whorl_math::statistics::{chi_squared_probability, chi_squared_quantile, normal_quantile};

/// Two-sided 99 % quantile of the standard normal distribution.
pub const NORMAL_99: f64 = 2.575_829_303_548_901;
/// Longest stretch for one transform of a periodogram, and the minimum number of values.
const LONGEST: usize = 4096;
const FEWEST: usize = 64;
/// Lines below this frequency are ignored: fitting the initial states of short stretches turns slow errors into such
/// lines \[Hz\].
const SLOWEST_LINE_HZ: f64 = 0.5;
/// A line has at least this many times the mean power per frequency and 2 % of the total power.
const LINE: f64 = 12.0;

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

/// Autocorrelations about the mean at lags 0, 1 and so on; `None` for values that do not vary.
#[must_use]
pub fn autocorrelations(values: &[f64]) -> Option<impl Iterator<Item = f64>> {
    let centred = centred(values);
    let power: f64 = centred.iter().map(|x| x * x).sum();
    let at = move |k: usize| centred.iter().zip(&centred[k..]).map(|(a, b)| a * b).sum::<f64>() / power;
    (power > 0.0 && power.is_finite()).then(|| (0..values.len()).map(at))
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
    // That the largest of all keeps with 99 %, from both sides.
    let joint = normal_quantile(1.0 - 0.005 / (2 * lags + 1) as f64);
    Some(CrossCorrelation { band_99: NORMAL_99 / root, joint_band_99: joint / root, lag, value })
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|x| x - mean).collect()
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

/// Share of a residual's power below each frequency.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CumulativePeriodogram {
    /// Frequency \[Hz\].
    pub frequency_hz: Vec<f64>,
    /// Share of the power up to it, 0..1.
    pub share: Vec<f64>,
    /// 99 % band about the straight line for white residuals.
    pub band_99: f64,
    /// Largest distance from the straight line, with its sign: > 0 = too much power at low frequencies.
    pub largest_deviation: f64,
    /// Frequency of the largest distance \[Hz\].
    pub largest_deviation_hz: f64,
    /// Frequency of the strongest line, if one stands out \[Hz\].
    pub line_hz: Option<f64>,
}

impl CumulativePeriodogram {
    /// Whether the residuals pass as white.
    #[must_use]
    pub fn is_white(&self) -> bool {
        self.largest_deviation.abs() <= self.band_99
    }
}

/// Cumulative periodogram of evenly spaced values, the mean of stretches of equal length.
///
/// The band is that of the Kolmogorov-Smirnov statistic for as many ordinates as were averaged over
/// (M. S. Bartlett, *An Introduction to Stochastic Processes*, 1955; 1.63 / sqrt(m) for 99 %).
#[must_use]
pub fn cumulative_periodogram(residual: &[f64], rate_hz: f64) -> Option<CumulativePeriodogram> {
    if residual.len() < FEWEST || !residual.iter().all(|x| x.is_finite()) {
        return None;
    }
    let longest = residual.len().min(LONGEST);
    let length = if longest.is_power_of_two() { longest } else { longest.next_power_of_two() / 2 };
    let mut sum = vec![0.0; length / 2 - 1];
    let fourier = Fourier::of_length(length);
    let residual = centred(residual);
    for stretch in residual.chunks_exact(length) {
        let power = fourier.power(stretch.iter().copied()).into_iter().skip(1);
        sum.iter_mut().zip(power).for_each(|(sum, power)| *sum += power);
    }
    let total: f64 = sum.iter().sum();
    if total <= 0.0 {
        return None;
    }
    let count = sum.len() as f64;
    let mut periodogram = CumulativePeriodogram {
        frequency_hz: (1..length / 2).map(|k| k as f64 * rate_hz / length as f64).collect(),
        share: Vec::with_capacity(sum.len()),
        band_99: 1.63 / (count * (residual.len() / length) as f64).sqrt(),
        largest_deviation: 0.0,
        largest_deviation_hz: 0.0,
        line_hz: None,
    };
    let (mut below, mut strongest) = (0.0, 0.0);
    for (k, (power, frequency_hz)) in sum.iter().zip(&periodogram.frequency_hz).enumerate() {
        below += power;
        let share = below / total;
        periodogram.share.push(share);
        let deviation = share - (k + 1) as f64 / count;
        if deviation.abs() > periodogram.largest_deviation.abs() {
            periodogram.largest_deviation = deviation;
            periodogram.largest_deviation_hz = *frequency_hz;
        }
        let fast = k >= 4 && *frequency_hz >= SLOWEST_LINE_HZ;
        if fast && *power > strongest && *power * count > LINE * total && *power > 0.02 * total {
            strongest = *power;
            periodogram.line_hz = Some(*frequency_hz);
        }
    }
    Some(periodogram)
}
