//! Noise estimated from the data.

use crate::statistics::median;

/// Minimum number of values for an estimate of noise.
const FEWEST: usize = 30;
/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.6745;
/// If the median's estimate is below this share of the mean's, the values are digitised too coarsely for the median.
const COARSE: f64 = 0.3;
/// Stamps that scatter by more than this share of their interval are not regular samples with jitter.
const MOST_JITTER: f64 = 0.2;

/// Standard deviation of the noise of one sample, from second differences of neighbouring samples: they contain almost
/// no motion, and the variance of x1 - 2 x2 + x3 is six times that of white noise. The median is robust to jet edges,
/// the mean to coarse digitisation. `None` for fewer than 30 values, or if all second differences are zero.
#[must_use]
pub fn from_second_differences(values: &[f64]) -> Option<f64> {
    if values.len() < FEWEST {
        return None;
    }
    let bends: Vec<f64> = second_differences(values).collect();
    let rms = (bends.iter().map(|d| d * d).sum::<f64>() / bends.len() as f64 / 6.0).sqrt();
    let typical = median(bends) / (NORMAL_MEDIAN * 6f64.sqrt());
    let spread = if typical > COARSE * rms { typical } else { rms };
    (spread > 0.0).then_some(spread)
}

/// |x1 - 2 x2 + x3| of all neighbouring samples.
pub fn second_differences(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    values.windows(3).map(|w| if let [a, b, c] = w { (c - 2.0 * b + a).abs() } else { 0.0 })
}

/// Typical time between stamps \[s\]: the median. 0.01 s where there are fewer than two.
#[must_use]
pub fn typical_step_s(time_s: &[f64]) -> f64 {
    let typical = median(time_s.windows(2).map(|w| if let [a, b] = w { b - a } else { f64::NAN }));
    if typical.is_nan() { 0.01 } else { typical }
}

/// Standard deviation of stamps about a regular interval \[s\], from their second differences; by the median, since
/// samples may be lost. 0 if samples are irregular.
#[must_use]
pub fn stamp_jitter_s(time_s: &[f64]) -> f64 {
    if time_s.len() < 12 {
        return 0.0;
    }
    let jitter_s = median(second_differences(time_s)) / NORMAL_MEDIAN / 6f64.sqrt();
    if jitter_s < MOST_JITTER * typical_step_s(time_s) { jitter_s } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal noise of known standard deviation: a sum of twelve uniform variables, whose tails are nearly normal.
    fn noise(sigma: f64, count: i32) -> impl Iterator<Item = f64> {
        let mut seed = 7u64;
        let mut uniform = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count).map(move |_| sigma * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0))
    }

    fn scattered(sigma: f64) -> Vec<f64> {
        noise(sigma, 20_000).enumerate().map(|(i, jitter)| 0.005 * i as f64 + jitter).collect()
    }

    #[test]
    fn jitter_is_found_and_even_stamps_have_none() {
        let found = stamp_jitter_s(&scattered(3e-4));
        assert!((found / 3e-4 - 1.0).abs() < 0.05, "{found}");
        assert!(stamp_jitter_s(&scattered(0.0)) < 1e-12);
        // Irregular samples have no jitter.
        assert_eq!(stamp_jitter_s(&scattered(2e-3)), 0.0);
    }

    #[test]
    fn noise_is_found_under_motion_with_jumps_and_coarse_digits() {
        let moving = |digits: f64| -> Vec<f64> {
            let motion = |k: usize| (0.01 * k as f64).sin() + if k % 50 > 25 { 0.01 } else { 0.0 };
            let exact = noise(2e-3, 20_000).enumerate().map(|(k, n)| motion(k) + n);
            exact.map(|x| if digits > 0.0 { (x / digits).round() * digits } else { x }).collect()
        };
        let found = from_second_differences(&moving(0.0)).unwrap();
        assert!((found / 2e-3 - 1.0).abs() < 0.1, "{found}");
        // A step of 2 mrad/s adds its own variance, 1/12 of its square.
        let found = from_second_differences(&moving(2e-3)).unwrap();
        assert!((0.8..1.6).contains(&(found / 2e-3)), "{found}");
        assert_eq!(from_second_differences(&[1.0; 100]), None);
        assert_eq!(from_second_differences(&[1.0, 2.0, 4.0]), None);
    }
}
