//! Autoregressive (AR) models of the innovations of each channel: the correlation of noise from sample to sample.

use std::collections::BTreeMap;

use whorl_math::statistics::median;
use whorl_recording::Component;

use crate::Settings;

/// Highest order of the model of coloured noise.
const ORDER: usize = 6;

/// Stretches of a run from which the AR model of its noise is estimated.
const STRETCHES: usize = 8;

/// Rows of each component, in order; components in their own order.
pub(crate) fn rows_by_reading(readings: impl Iterator<Item = Component>) -> Vec<Vec<usize>> {
    let mut rows: BTreeMap<Component, Vec<usize>> = BTreeMap::new();
    for (row, reading) in readings.enumerate() {
        rows.entry(reading).or_default().push(row);
    }
    rows.into_values().collect()
}

/// Passes a series of readings through the filters of coloured noise.
pub(crate) fn whiten_series(series: &mut [f64], rows: &[Vec<usize>], ar_models: &[ArModel]) {
    for (rows, ar_model) in rows.iter().zip(ar_models) {
        ar_model.whiten(rows, series, |y, x, factor| *y += factor * x, |y, factor| *y *= factor);
    }
}

/// Log density that the innovation sizes of these AR models give the innovations of a run, where these are zero.
pub(crate) fn ar_log_density(rows: &[Vec<usize>], ar_models: &[ArModel]) -> f64 {
    rows.iter().zip(ar_models).map(|(rows, ar_model)| -(rows.len() as f64) * ar_model.stddev.ln()).sum()
}

/// AR model of one channel's whitened innovation, and the size of its own innovation.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct ArModel {
    pub coefficients: Vec<f64>,
    pub stddev: f64,
    /// Power of the innovation, over that of white noise of the measured size.
    pub power: f64,
}

impl ArModel {
    /// From a residual, by Yule-Walker; the order by Akaike's criterion.
    pub fn of(residual: &[f64], settings: &Settings) -> Self {
        let n = residual.len();
        if n < 100 {
            let power = residual.iter().map(|e| e * e).sum::<f64>() / n.max(1) as f64;
            return Self {
                coefficients: Vec::new(),
                stddev: if n > 20 { power.sqrt().max(0.2) } else { 1.0 },
                power,
            };
        }
        let clipped: Vec<f64> = {
            let power = residual.iter().map(|e| e * e).sum::<f64>() / n as f64;
            let limit = 5.0 * power.sqrt();
            residual.iter().map(|e| e.max(-limit).min(limit)).collect()
        };
        // What is slower than a few dozen samples is a torque or a bias, and no correlation of a sensor's noise.
        let clipped = without_slow_part(&clipped, settings.ar_window_samples.round() as usize);
        // The median over stretches: what a model lacks for a while is no noise.
        let stretch = n.div_ceil(STRETCHES).max(50);
        let lag = |l: usize| {
            median(clipped.chunks(stretch).filter(|c| 2 * c.len() >= stretch).map(|c| {
                c.iter().zip(c.iter().skip(l)).map(|(a, b)| a * b).sum::<f64>() / (c.len() - l) as f64
            }))
        };
        let r: Vec<f64> = (0..=ORDER).map(lag).collect();
        let mut best = Self { coefficients: Vec::new(), stddev: r[0].sqrt().max(1e-3), power: r[0] };
        let mut best_score = n as f64 * r[0].max(1e-12).ln();
        let (mut a, mut power) = (Vec::<f64>::new(), r[0]);
        for order in 1..=ORDER {
            // Levinson-Durbin.
            let mut numerator = r[order];
            for (i, coefficient) in a.iter().enumerate() {
                numerator -= coefficient * r[order - 1 - i];
            }
            let reflection = if power > 0.0 { numerator / power } else { 0.0 };
            if reflection.abs() >= 1.0 {
                break;
            }
            let mut next = a.clone();
            for i in 0..a.len() {
                next[i] -= reflection * a[a.len() - 1 - i];
            }
            next.push(reflection);
            a = next;
            power *= 1.0 - reflection * reflection;
            let score = n as f64 * power.max(1e-12).ln() + settings.ar_order_price * order as f64;
            if score < best_score {
                best_score = score;
                best = Self { coefficients: a.clone(), stddev: power.sqrt().max(1e-3), power: r[0] };
            }
        }
        // Innovations smaller than the measured noise are a sign of too much random torque in the filter: readings are no
        // better than their second differences. If innovations were scaled up here, the excess torque would never be found.
        best.stddev /= r[0].clamp(1e-6, 1.0).sqrt();
        best
    }

    pub fn whiten<T: Clone>(
        &self,
        rows: &[usize],
        data: &mut [T],
        add: impl Fn(&mut T, &T, f64),
        scale: impl Fn(&mut T, f64),
    ) {
        for position in (0..rows.len()).rev() {
            let Some(&row) = rows.get(position) else { continue };
            let Some(mut value) = data.get(row).cloned() else { continue };
            for (i, coefficient) in self.coefficients.iter().enumerate() {
                let earlier =
                    position.checked_sub(i + 1).and_then(|p| rows.get(p)).and_then(|r| data.get(*r));
                if let Some(earlier) = earlier {
                    add(&mut value, earlier, -coefficient);
                }
            }
            scale(&mut value, 1.0 / self.stddev);
            if let Some(slot) = data.get_mut(row) {
                *slot = value;
            }
        }
    }
}

/// AR model of each channel of each run.
pub(crate) type ArModels = Vec<Vec<ArModel>>;

/// Relative difference of two sizes of innovations that changes no answer: that of a standard deviation from 1,000 samples.
const ALIKE: f64 = 0.02;

/// Whether two estimates of the same AR models give innovations of the same size.
pub(crate) fn alike(one: &ArModels, other: &ArModels) -> bool {
    let mut all = one.iter().flatten().zip(other.iter().flatten());
    one.len() == other.len() && all.all(|(a, b)| (a.stddev / b.stddev - 1.0).abs() < ALIKE)
}

/// AR models of a run's series of readings, whose rows are given by component.
pub(crate) fn ar_models_of(series: &[f64], rows: &[Vec<usize>], settings: &Settings) -> Vec<ArModel> {
    let of_component = |rows: &Vec<usize>| {
        let own: Vec<f64> = rows.iter().filter_map(|row| series.get(*row).copied()).collect();
        ArModel::of(&own, settings)
    };
    rows.iter().map(of_component).collect()
}

/// A series less its running mean over so many samples to both sides, in its own scale: white noise keeps its power.
fn without_slow_part(series: &[f64], half: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for x in series {
        sums.push(sums[sums.len() - 1] + x);
    }
    let of = |i: usize, x: &f64| {
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(series.len()));
        let count = (to - from) as f64;
        let mean = (sums[to] - sums[from]) / count;
        (x - mean) / (1.0 - 1.0 / count).sqrt()
    };
    series.iter().enumerate().map(|(i, x)| of(i, x)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_autoregressive_residual_becomes_white() {
        let mut x = vec![0.0_f64; 4000];
        let mut state = 12_345_u64;
        for k in 1..x.len() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let uniform = (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
            x[k] = 0.8 * x[k - 1] + uniform * 12f64.sqrt();
        }
        let ar_model = ArModel::of(&x, &Settings::default());
        assert!((ar_model.coefficients[0] - 0.8).abs() < 0.08, "{ar_model:?}");
        let rows: Vec<usize> = (0..x.len()).collect();
        let mut y = x.clone();
        ar_model.whiten(&rows, &mut y, |y, x, f| *y += f * x, |y, f| *y *= f);
        let power: f64 = y.iter().map(|v| v * v).sum::<f64>() / y.len() as f64;
        let lag: f64 = y.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / y.len() as f64;
        assert!((power - 1.0).abs() < 0.05 && lag.abs() < 0.1, "{power} {lag}");
    }
}
