//! Speeds of wheels as their tachometers show them, without the noise (METHOD.md, "What is known of it": Carroll et al., *Measurement Error in
//! Nonlinear Models*, 2nd ed., chapter 4). Each wheel's speed is the integral of an acceleration that walks randomly, as fast as makes its readings
//! likeliest, smoothed forwards and backwards (Rauch, Tung and Striebel, AIAA Journal 3, 1965):
//!
//! ```text
//! dOmega = alpha dt,  d alpha = white noise of density lambda R,  reading = Omega + noise of variance R
//! ```

use nalgebra::{Matrix2, Vector2};
use whorl_recording::{Recording, Series};

use whorl_math::noise::typical_step_s;

/// lambda times the cube of the step: from hundreds of readings smoothed together to next to nothing, decades apart. The smoother's bandwidth
/// goes with the fourth root.
const SPEED_OF_WALK: std::ops::RangeInclusive<i32> = -9..=2;
/// Variance before the first reading, in variances of a reading (and of a reading per step).
const UNKNOWN: f64 = 1e8;

/// Smoothed speeds of the wheels of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenSpeeds {
    /// Speeds by wheel at the stamps of the readings [rad/s].
    pub speed_rad_s: Series<Vec<f64>>,
    /// By wheel: the root of the power density of the noise of its readings [rad/s per root of Hz]. Over times that are longer than
    /// what is smoothed together the smoothed speed has the same.
    pub noise_root: Vec<f64>,
}

/// State and covariance, the latter in variances of a reading.
type Normal = (Vector2<f64>, Matrix2<f64>);

impl DrivenSpeeds {
    /// Of a recording's readings; those that are no numbers are passed over.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let read = &recording.wheel_speed_rad_s;
        let step_s = typical_step_s(&read.time_s);
        let wheels = read.value.iter().map(Vec::len).max().unwrap_or(0);
        let mut value = vec![vec![0.0; wheels]; read.time_s.len()];
        let mut noise_root = Vec::new();
        for j in 0..wheels {
            let speeds: Vec<f64> =
                read.value.iter().map(|speeds| speeds.get(j).copied().unwrap_or(f64::NAN)).collect();
            let walks = SPEED_OF_WALK.map(|power| 10f64.powi(power) / step_s.powi(3));
            let mut best = Pass::new(&read.time_s, &speeds, 0.0);
            for walk in walks {
                let pass = Pass::new(&read.time_s, &speeds, walk);
                if pass.log > best.log || !best.log.is_finite() {
                    best = pass;
                }
            }
            for (row, speed) in value.iter_mut().zip(best.smoothed(&read.time_s)) {
                row[j] = speed;
            }
            let variance = if best.variance.is_finite() { best.variance } else { 0.0 };
            noise_root.push((variance * step_s.max(0.0)).sqrt());
        }
        Self { speed_rad_s: Series { time_s: read.time_s.clone(), value }, noise_root }
    }
}

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
    fn new(time_s: &[f64], speeds: &[f64], walk: f64) -> Self {
        let first = speeds.iter().copied().find(|x| x.is_finite()).unwrap_or(0.0);
        let length_s =
            time_s.last().zip(time_s.first()).map_or(1.0, |(last, first)| (last - first).max(1e-9));
        let step_s = length_s / time_s.len().max(2) as f64;
        let mut now: Normal = (
            Vector2::new(first, 0.0),
            Matrix2::from_diagonal(&Vector2::new(UNKNOWN, UNKNOWN / (step_s * step_s))),
        );
        let (mut squares, mut logs, mut count) = (0.0, 0.0, 0.0);
        let mut filtered = Vec::with_capacity(speeds.len());
        let mut before = time_s.first().copied().unwrap_or(0.0);
        for (t, y) in time_s.iter().zip(speeds) {
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

    /// Speeds given all readings.
    fn smoothed(&self, time_s: &[f64]) -> Vec<f64> {
        let mut speeds: Vec<f64> = self.filtered.iter().map(|(x, _)| x[0]).collect();
        let Some((mut later, _)) = self.filtered.last().copied() else { return speeds };
        for k in (0..self.filtered.len().saturating_sub(1)).rev() {
            let (x, p) = &self.filtered[k];
            let h_s = time_s[k + 1] - time_s[k];
            let (expected, variance) = ahead(&self.filtered[k], h_s, self.walk);
            // Where nothing walks and nothing is uncertain there is nothing to be corrected.
            let gain = variance.try_inverse().map(|inverse| p * motion(h_s).transpose() * inverse);
            later = x + gain.unwrap_or_else(Matrix2::zeros) * (later - expected);
            speeds[k] = later[0];
        }
        speeds
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

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize) -> f64 {
        // Uniform of variance 1: fractions of multiples of the golden ratio, shuffled by a square.
        let u = ((k * k) as f64 * 0.618_033_988_75 + k as f64 * 0.414_213_562).fract();
        12f64.sqrt() * (u - 0.5)
    }

    fn recorded(step_s: f64, speed: &dyn Fn(f64) -> f64, stddev: f64) -> Recording {
        let time_s: Vec<f64> = (0..4000).map(|k| step_s * f64::from(k)).collect();
        let value = time_s.iter().enumerate().map(|(k, t)| vec![speed(*t) + stddev * noise(k)]).collect();
        Recording { wheel_speed_rad_s: Series { time_s, value }, ..Recording::default() }
    }

    /// A slow swing far below the digits of its reading, jumps of the torque, and a ramp.
    #[test]
    fn what_is_smoothed_is_closer_to_the_truth_than_readings_are() {
        let swing = |t: f64| 0.4 * t.sin();
        let jumps = |t: f64| 5.0 * ((t + 2.5).rem_euclid(10.0) - 5.0).abs();
        let ramp = |t: f64| 50.0 + 2.0 * t;
        for (speed, better) in [(&swing as &dyn Fn(f64) -> f64, 4.0), (&jumps, 1.5), (&ramp, 10.0)] {
            let run = recorded(0.01, speed, 0.05);
            let found = DrivenSpeeds::of(&run);
            let squares: f64 = run
                .wheel_speed_rad_s
                .time_s
                .iter()
                .zip(&found.speed_rad_s.value)
                .map(|(t, found)| (found[0] - speed(*t)).powi(2))
                .sum();
            let error = (squares / 4000.0).sqrt();
            assert!(error < 0.05 / better, "{error} {better}");
            assert!((found.noise_root[0] / (0.05 * 0.1) - 1.0).abs() < 0.1, "{}", found.noise_root[0]);
        }
    }

    #[test]
    fn numbers_that_are_none_and_constants_do_no_harm() {
        let mut run = recorded(0.01, &|t| 0.4 * t.sin(), 0.05);
        for k in 100..200 {
            run.wheel_speed_rad_s.value[k][0] = f64::NAN;
        }
        let found = DrivenSpeeds::of(&run);
        for (t, speed) in run.wheel_speed_rad_s.time_s.iter().zip(&found.speed_rad_s.value) {
            assert!((speed[0] - 0.4 * t.sin()).abs() < 0.06, "{t} {}", speed[0]);
        }
        let still = DrivenSpeeds::of(&recorded(0.01, &|_| 3.0, 0.0));
        assert!(still.speed_rad_s.value.iter().all(|speed| (speed[0] - 3.0).abs() < 1e-6));
        assert!(still.noise_root[0] < 1e-6);
        assert_eq!(DrivenSpeeds::of(&Recording::default()).noise_root.len(), 0);
    }
}
