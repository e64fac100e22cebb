//! Bartlett's cumulative periodogram.

use serde::Serialize;
use whorl_math::spectrum::Fourier;

/// Longest stretch for one transform.
const LONGEST: usize = 4096;
/// Minimum number of values.
const FEWEST: usize = 64;
/// Lines below this frequency are ignored: fitting the initial states of short stretches turns slow errors into such
/// lines \[Hz\].
const SLOWEST_LINE_HZ: f64 = 0.5;
/// A line has at least this many times the mean power per frequency and 2 % of the total power.
const LINE: f64 = 12.0;

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
    let mean = residual.iter().sum::<f64>() / residual.len() as f64;
    let mut sum = vec![0.0; length / 2 - 1];
    let mut stretches = 0;
    let fourier = Fourier::of_length(length);
    for stretch in residual.chunks_exact(length) {
        let power = fourier.power(stretch.iter().map(|x| x - mean));
        for (sum, power) in sum.iter_mut().zip(power.into_iter().skip(1)) {
            *sum += power;
        }
        stretches += 1;
    }
    let total: f64 = sum.iter().sum();
    if total <= 0.0 {
        return None;
    }
    let count = sum.len() as f64;
    let mut periodogram = CumulativePeriodogram {
        frequency_hz: (1..length / 2).map(|k| k as f64 * rate_hz / length as f64).collect(),
        share: Vec::with_capacity(sum.len()),
        band_99: 1.63 / (count * f64::from(stretches)).sqrt(),
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
