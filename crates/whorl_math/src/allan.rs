//! Allan deviation: how the noise of a sensor averages out.

use nalgebra::{Matrix2, Vector2};

/// One point of an Allan deviation curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AllanPoint {
    /// Averaging time \[s\].
    pub tau_s: f64,
    /// Allan deviation at that time, in the unit of the samples.
    pub deviation: f64,
    /// Relative standard deviation of `deviation`, 1 / sqrt(2 (n - 1)) with n independent averages
    /// (IEEE Std 952-1997, C.1.6).
    pub relative_error: f64,
}

/// Overlapping Allan deviation of evenly spaced samples of a rate (or any signal) at averaging times of
/// about `per_decade` to the decade, from one sample to a third of the record.
///
/// ```text
/// sigma^2(m dt) = 1 / (2 (N - 2m + 1)) sum_i (mean_{i+m} - mean_i)^2,   mean_i over m samples from i
/// ```
///
/// White noise of standard deviation s per sample gives s sqrt(dt / tau); a random walk of intensity K
/// (unit per square root of a second) gives K sqrt(tau / 3). Source: D. W. Allan, Proc. IEEE 54(2), 1966;
/// IEEE Std 952-1997, annex C.
///
/// Empty for fewer than nine samples, a sample time that is not positive, or samples that are not finite.
#[must_use]
pub fn allan_deviation(samples: &[f64], sample_time_s: f64, per_decade: usize) -> Vec<AllanPoint> {
    let count = samples.len();
    let usable = sample_time_s > 0.0 && sample_time_s.is_finite() && samples.iter().all(|x| x.is_finite());
    if count < 9 || !usable || per_decade == 0 {
        return Vec::new();
    }
    // Sums over m samples as differences of one running sum; the mean is taken out first to keep digits.
    let mean = samples.iter().sum::<f64>() / count as f64;
    let mut running = Vec::with_capacity(count + 1);
    let mut total = 0.0;
    running.push(0.0);
    for x in samples {
        total += x - mean;
        running.push(total);
    }
    let mut points = Vec::new();
    let mut last = 0;
    for step in 0.. {
        let m = 10f64.powf(step as f64 / per_decade as f64).round() as usize;
        if m > count / 3 {
            break;
        }
        if m == last {
            continue;
        }
        last = m;
        let ends = running.iter().zip(running.iter().skip(m)).zip(running.iter().skip(2 * m));
        let sum: f64 = ends.map(|((a, b), c)| (c - 2.0 * b + a).powi(2)).sum();
        let terms = (count + 1 - 2 * m) as f64;
        let independent = (count as f64 / m as f64 - 1.0).max(1.0);
        points.push(AllanPoint {
            tau_s: m as f64 * sample_time_s,
            deviation: (sum / (2.0 * terms)).sqrt() / m as f64,
            relative_error: 1.0 / (2.0 * independent).sqrt(),
        });
    }
    points
}

/// Neighbouring points share most of their samples, and a walk's averages hang together: standard deviations of a fit that takes
/// points for independent grow by these, of the white noise and of the walk (scatter of 60 simulated records each, of 100 to
/// 700 s, over what the fit stated: 1.6 to 1.8 and 1.6 to 2.9) \[1\].
const SHARED: [f64; 2] = [1.8, 3.0];
/// The weights follow from the fit, and the fit from the weights.
const ROUNDS: usize = 10;
/// Points with a larger relative error, of fewer than nine averages, may be low by chance \[1\].
const UNKNOWN: f64 = 0.25;

/// Noise densities read from an Allan deviation curve, with their standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseDensities {
    /// White noise N: unit times sqrt(s), that is unit per sqrt(Hz); standard deviation of a sample is
    /// N / sqrt(sample time).
    pub white: f64,
    /// Its standard deviation.
    pub white_stddev: f64,
    /// Random walk K: unit per sqrt(s). An upper bound where `walk_seen` is false.
    pub walk: f64,
    /// Its standard deviation where it was seen; else infinite.
    pub walk_stddev: f64,
    /// Whether the record is long enough for the walk to rise out of the white noise.
    pub walk_seen: bool,
    /// Bias instability: the lowest Allan deviation among those that enough averages support.
    pub floor: f64,
    /// Its standard deviation.
    pub floor_stddev: f64,
    /// Whether averaging longer does not help any more: the curve's lowest point is not its last. The floor is only then that of the
    /// sensor.
    pub floor_seen: bool,
}

/// Fits sigma^2(tau) = N^2 / tau + K^2 tau / 3 with both parts >= 0 to a curve, each point weighted with
/// its own relative error. `None` for fewer than four points.
#[must_use]
pub fn noise_densities(curve: &[AllanPoint]) -> Option<NoiseDensities> {
    let points: Vec<_> = curve.iter().filter(|p| p.deviation > 0.0).collect();
    if points.len() < 4 {
        return None;
    }
    let row = |p: &AllanPoint| Vector2::new(p.tau_s.recip(), p.tau_s / 3.0);
    // N^2 and K^2, their covariance, and N^2 without a walk; with the variances that points are taken to show.
    let fit = |variance: &dyn Fn(&AllanPoint) -> f64| {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for p in &points {
            // The variance has twice the relative error of the deviation.
            let weight = (2.0 * p.relative_error * variance(p)).powi(-2);
            normal += row(p) * row(p).transpose() * weight;
            right += row(p) * (weight * p.deviation.powi(2));
        }
        let covariance = normal.try_inverse().unwrap_or_else(|| Matrix2::repeat(f64::INFINITY));
        (covariance * right, covariance.map_diagonal(|x| x.max(0.0).sqrt()), right.x / normal.m11)
    };
    let (first, stddevs, alone) = fit(&|p| p.deviation.powi(2));
    let walk_seen = first.y > 3.0 * stddevs.y && stddevs.y.is_finite();
    let mut squares = if walk_seen && first.x > 0.0 {
        first
    } else {
        Vector2::new(alone.max(0.0), first.y.max(0.0) + 2.0 * stddevs.y)
    };
    // Now with what the fitted curve says: measured points that are low by chance would count for more than those that are high.
    let mut stddevs = stddevs;
    for _ in 0..if walk_seen { ROUNDS } else { 1 } {
        let found;
        (found, stddevs, _) = fit(&|p| row(p).dot(&squares));
        if !walk_seen || !found.iter().all(|square| *square > 0.0) {
            break;
        }
        squares = found;
    }
    let [white, walk] = [squares.x.sqrt(), squares.y.sqrt()];
    let of = |which: usize, value: f64| {
        let stddev = SHARED[which] * stddevs[which] / (2.0 * value);
        if stddev.is_finite() { stddev } else { f64::INFINITY }
    };
    let known: Vec<&AllanPoint> = curve.iter().filter(|p| p.relative_error < UNKNOWN).collect();
    let lowest = known.iter().enumerate().min_by(|(_, a), (_, b)| a.deviation.total_cmp(&b.deviation));
    Some(NoiseDensities {
        white,
        white_stddev: of(0, white),
        walk,
        walk_stddev: if walk_seen { of(1, walk) } else { f64::INFINITY },
        walk_seen,
        floor: lowest.map_or(0.0, |(_, p)| p.deviation),
        floor_stddev: lowest.map_or(f64::INFINITY, |(_, p)| p.deviation * p.relative_error),
        floor_seen: lowest.is_some_and(|(index, _)| index + 1 < known.len()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Standard normal numbers from a linear congruential generator and the sum of twelve uniforms.
    fn normals(count: usize, mut state: u64) -> Vec<f64> {
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
    }

    /// The curve of five numbers, worked out by hand from the definition.
    #[test]
    fn matches_the_definition_on_a_short_record() {
        let x = [1.0, 3.0, 2.0, 6.0, 4.0, 4.0, 1.0, 0.0, 2.0];
        let curve = allan_deviation(&x, 0.5, 3);
        // m = 1: differences 2, -1, 4, -2, 0, -3, -1, 2: squares sum to 39, over 2 * 8.
        assert!((curve[0].deviation - (39.0f64 / 16.0).sqrt()).abs() < 1e-12);
        assert_eq!(curve[0].tau_s, 0.5);
        // m = 2: pair means 2, 2.5, 4, 5, 4, 2.5, 0.5, 1; second minus first two apart: 2, 2.5, 0, -2.5,
        // -3.5, -1.5: squares sum to 31, over 2 * 6.
        assert!((curve[1].deviation - (31.0f64 / 12.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn white_noise_and_random_walk_are_told_apart() {
        let (dt, white, walk) = (0.01_f64, 0.02, 0.004);
        let noise = normals(60_000, 5);
        let steps = normals(60_000, 77);
        let mut bias = 0.0;
        let samples: Vec<f64> = noise
            .iter()
            .zip(&steps)
            .map(|(n, s)| {
                bias += walk * dt.sqrt() * s;
                bias + white / dt.sqrt() * n
            })
            .collect();
        let curve = allan_deviation(&samples, dt, 8);
        let found = noise_densities(&curve).unwrap();
        assert!((found.white / white - 1.0).abs() < 0.02, "{found:?}");
        assert!(found.walk_seen && (found.walk / walk - 1.0).abs() < 0.25, "{found:?}");
        // Without the walk the fit must say that it saw none.
        let still: Vec<f64> = noise.iter().map(|n| white / dt.sqrt() * n).collect();
        let found = noise_densities(&allan_deviation(&still, dt, 8)).unwrap();
        assert!(!found.walk_seen, "{found:?}");
        assert!((found.white / white - 1.0).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn unusable_records_give_nothing() {
        assert!(allan_deviation(&[1.0; 5], 0.1, 4).is_empty());
        assert!(allan_deviation(&[1.0; 50], 0.0, 4).is_empty());
        assert!(allan_deviation(&[f64::NAN; 50], 0.1, 4).is_empty());
        assert_eq!(noise_densities(&allan_deviation(&[1.0; 50], 0.1, 4)), None);
    }
}
