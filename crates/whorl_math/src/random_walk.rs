//! Readings of something smooth, smoothed: the integral of a slope that walks randomly, as fast as makes the readings likeliest, forwards and backwards
//! (Rauch, Tung and Striebel, AIAA Journal 3, 1965):
//!
//! ```text
//! dx = v dt,  dv = white noise of density lambda R,  reading = x + noise of variance R
//! ```

use nalgebra::{Matrix2, Vector2};

use crate::noise::typical_step_s;

/// lambda times the cube of the step: from hundreds of readings smoothed together to next to nothing, decades apart. The smoother's bandwidth
/// goes with the fourth root.
const SPEED_OF_WALK: std::ops::RangeInclusive<i32> = -9..=2;
/// Variance before the first reading, in variances of a reading (and of a reading per step).
const UNKNOWN: f64 = 1e8;

/// Readings at these times given all of them, and the variance of their noise; those that are no numbers are passed over.
#[must_use]
pub fn smoothed(time_s: &[f64], readings: &[f64]) -> (Vec<f64>, f64) {
    let mut best = Pass::new(time_s, readings, 0.0);
    for power in SPEED_OF_WALK {
        let pass = Pass::new(time_s, readings, 10f64.powi(power) / typical_step_s(time_s).powi(3));
        if pass.log > best.log || !best.log.is_finite() {
            best = pass;
        }
    }
    (best.smoothed(time_s), if best.variance.is_finite() { best.variance } else { 0.0 })
}

/// State and covariance, the latter in variances of a reading.
type Normal = (Vector2<f64>, Matrix2<f64>);

/// A pass of the filter.
struct Pass {
    walk: f64,
    /// Behind each reading.
    filtered: Vec<Normal>,
    /// Likeliest variance of a reading.
    variance: f64,
    /// log p of the readings, the variance at its likeliest.
    log: f64,
}

impl Pass {
    fn new(time_s: &[f64], readings: &[f64], walk: f64) -> Self {
        let first = readings.iter().copied().find(|x| x.is_finite()).unwrap_or(0.0);
        let length_s =
            time_s.last().zip(time_s.first()).map_or(1.0, |(last, first)| (last - first).max(1e-9));
        let step_s = length_s / time_s.len().max(2) as f64;
        let unknown = Matrix2::from_diagonal(&Vector2::new(UNKNOWN, UNKNOWN / (step_s * step_s)));
        let mut now: Normal = (Vector2::new(first, 0.0), unknown);
        let (mut squares, mut logs, mut count) = (0.0, 0.0, 0.0);
        let mut filtered = Vec::with_capacity(readings.len());
        let mut before = time_s.first().copied().unwrap_or(0.0);
        for (t, y) in time_s.iter().zip(readings) {
            now = ahead(&now, t - before, walk);
            before = *t;
            if y.is_finite() {
                let (x, p) = &mut now;
                let (error, variance) = (y - x[0], p[(0, 0)] + 1.0);
                let gain = p.column(0) / variance;
                *x += gain * error;
                *p -= gain * p.row(0);
                squares += error * error / variance;
                logs += variance.ln();
                count += 1.0;
            }
            filtered.push(now);
        }
        let variance = squares / count;
        Self { walk, filtered, variance, log: -0.5 * (count * variance.ln() + logs) }
    }

    /// Values given all readings.
    fn smoothed(&self, time_s: &[f64]) -> Vec<f64> {
        let mut values: Vec<f64> = self.filtered.iter().map(|(x, _)| x[0]).collect();
        let Some((mut later, _)) = self.filtered.last().copied() else { return values };
        for k in (0..self.filtered.len().saturating_sub(1)).rev() {
            let (x, p) = &self.filtered[k];
            let h_s = time_s[k + 1] - time_s[k];
            let (expected, variance) = ahead(&self.filtered[k], h_s, self.walk);
            // Where nothing walks and nothing is uncertain there is nothing to be corrected.
            let gain = variance.try_inverse().map(|inverse| p * motion(h_s).transpose() * inverse);
            later = x + gain.unwrap_or_else(Matrix2::zeros) * (later - expected);
            values[k] = later[0];
        }
        values
    }
}

fn motion(h_s: f64) -> Matrix2<f64> {
    Matrix2::new(1.0, h_s, 0.0, 1.0)
}

fn ahead((x, p): &Normal, h_s: f64, walk: f64) -> Normal {
    let f = motion(h_s);
    let walked = Matrix2::new(h_s.powi(3) / 3.0, h_s * h_s / 2.0, h_s * h_s / 2.0, h_s) * walk;
    (f * x, f * p * f.transpose() + walked)
}
