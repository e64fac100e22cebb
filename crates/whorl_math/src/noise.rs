//! Noise estimated from the data.

use crate::statistics::median;

/// Minimum number of values for an estimate of noise.
const FEWEST: usize = 30;
/// Median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f64 = 0.6745;
/// If the median's estimate is below this share of the mean's, the values are digitised too coarsely for the median.
const COARSE: f64 = 0.3;

/// Standard deviation of the noise of one sample, from second differences of neighbouring samples: they contain almost
/// no motion, and the variance of x1 - 2 x2 + x3 is six times that of white noise. Where noise hangs together ([`samples_together`]) the three are as far
/// apart as it does. The median is robust to jet edges, the mean to coarse digitisation. `None` for fewer than 30 values, or if all second differences
/// are zero.
#[must_use]
pub fn from_second_differences(values: &[f64]) -> Option<f64> {
    if values.len() < FEWEST {
        return None;
    }
    let bends: Vec<f64> = second_differences_at(values, samples_together(values)).collect();
    let rms = (bends.iter().map(|d| d * d).sum::<f64>() / bends.len() as f64 / 6.0).sqrt();
    let typical = median(bends) / (NORMAL_MEDIAN * 6f64.sqrt());
    let spread = if typical > COARSE * rms { typical } else { rms };
    (spread > 0.0).then_some(spread)
}

/// |x1 - 2 x2 + x3| of all neighbouring samples.
pub fn second_differences(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    second_differences_at(values, 1)
}

/// The same of samples so many apart.
fn second_differences_at(values: &[f64], lag: usize) -> impl Iterator<Item = f64> + '_ {
    let bend = move |w: &[f64]| Some((w.first()? - 2.0 * w.get(lag)? + w.last()?).abs());
    values.windows(2 * lag + 1).filter_map(bend)
}

/// So many times its first lags are looked at, each twice the one before.
const LAGS: u32 = 9;
/// Squares of second differences stay where they are while they grow by less than this from one lag to twice that, and behind it not as noise
/// that hangs together still, twofold. ...
const STAYS: f64 = 1.25;
const TOGETHER_STILL: f64 = 2.0;
/// ... Where they grow by more than this, motion makes them: the integral of noise eightfold and more, and every smooth motion.
const MOTION: f64 = 4.0;
/// Noise of neighbours has less than this share of the variance of noise of samples far apart where it hangs together.
const TOGETHER: f64 = 0.25;
/// Where so much of that variance is reached, readings count as independent: one in w of a running mean over w.
const APART: f64 = 0.8;

/// Over how many samples the noise of a series hangs together, as where its maker took a running mean or a low-pass: one sample in so
/// many says what all of them do. 1 where noise is white, or hidden by motion.
///
/// With r the correlation of noise, squares of second differences at lag k are 6 - 8 r(k) + 2 r(2 k) of its variance: all the same where it is
/// white, growing from nothing to a plateau where it hangs together. Motion grows on, and faster.
#[must_use]
pub fn samples_together(values: &[f64]) -> usize {
    let values: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    let square = |lag: usize| median(second_differences_at(&values, lag)).powi(2);
    let lags = (0..LAGS).map(|n| 1_usize << n).take_while(|lag| FEWEST * lag < values.len());
    let mut squares: Vec<(usize, f64)> = Vec::new();
    for lag in lags {
        squares.push((lag, square(lag)));
        let [first, .., (before, low), (_, middle), (_, high)] = squares.as_slice() else { continue };
        if *high > MOTION * middle || *middle > MOTION * low || first.1 <= 0.0 {
            return 1;
        }
        if *middle < STAYS * low && *high < TOGETHER_STILL * middle {
            let together = first.1 < TOGETHER * low;
            let least = (1..=*before).find(|lag| square(*lag) > APART * low);
            return least.filter(|_| together).unwrap_or(1);
        }
    }
    1
}

/// Typical time between stamps \[s\]: the median. 0.01 s where there are fewer than two.
#[must_use]
pub fn typical_step_s(time_s: &[f64]) -> f64 {
    let typical = median(time_s.windows(2).map(|w| if let [a, b] = w { b - a } else { f64::NAN }));
    if typical.is_nan() { 0.01 } else { typical }
}

/// Start and step of a sensor's own clock, from stamps that jitter \[s\]; `None` where they do not tell. The median of thousands of steps that
/// jitter by a twentieth is off by 10^-3 of a step, which is several samples over a run: a line near half the sample
/// rate would lose half its power.
#[must_use]
pub fn sample_clock(stamps_s: &[f64]) -> Option<(f64, f64)> {
    let first_s = *stamps_s.first()?;
    let (mut start_s, mut step_s) = (first_s, typical_step_s(stamps_s).max(1e-4));
    for _ in 0..2 {
        // The sample's number follows the stamps slowly, so that no single one of them makes it slip.
        let (mut number, mut expected_s) = (0.0, start_s);
        let (mut count, mut sums, mut squares, mut products) = (0.0, (0.0, 0.0), 0.0, 0.0);
        for t in stamps_s {
            let steps = ((t - expected_s) / step_s).round().max(0.0);
            number += steps;
            expected_s += steps * step_s;
            expected_s += 0.05 * (t - expected_s);
            let since_first_s = t - first_s;
            count += 1.0;
            sums = (sums.0 + number, sums.1 + since_first_s);
            squares += number * number;
            products += number * since_first_s;
        }
        let spread = squares - sums.0 * sums.0 / count;
        if spread <= 0.0 {
            return None;
        }
        step_s = ((products - sums.0 * sums.1 / count) / spread).max(1e-4);
        start_s = first_s + (sums.1 - step_s * sums.0) / count;
    }
    Some((start_s, step_s))
}

/// Takes the mean over so many samples to both sides off every value; 0 where it is not `there`, or half of the others are not.
pub fn take_off_local_mean(values: &mut [f64], there: &[bool], half: usize) {
    let mut sums = vec![(0.0, 0.0)];
    let (mut sum, mut count) = (0.0, 0.0);
    for (x, is_there) in values.iter().zip(there) {
        let weight = f64::from(u8::from(*is_there));
        (sum, count) = (sum + weight * x, count + weight);
        sums.push((sum, count));
    }
    for (i, x) in values.iter_mut().enumerate() {
        let (a, b) = (sums[i.saturating_sub(half)], sums[(i + half + 1).min(there.len())]);
        *x = if there[i] && b.1 - a.1 > half as f64 { *x - (b.0 - a.0) / (b.1 - a.1) } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_is_found_behind_stamps_that_jitter() {
        let step_s = 0.010_003;
        // Every hundredth sample is lost, and a second of them.
        let stamps_s: Vec<f64> = (0..9000_u32)
            .zip(noise(5e-4, 9000))
            .filter(|(i, _)| i % 100 != 7 && !(4000..4100).contains(i))
            .map(|(i, jitter_s)| 5.0 + step_s * f64::from(i) + jitter_s)
            .collect();
        let (start_s, found_s) = sample_clock(&stamps_s).unwrap();
        assert!((start_s - 5.0).abs() < 1e-4, "{start_s}");
        // A twentieth of a sample over the whole run.
        assert!((found_s - step_s).abs() * 9000.0 < 0.05 * step_s, "{found_s}");
    }

    /// Normal noise of known standard deviation: a sum of twelve uniform variables, whose tails are nearly normal.
    fn noise(sigma: f64, count: i32) -> impl Iterator<Item = f64> {
        let mut seed = 7u64;
        let mut uniform = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count).map(move |_| sigma * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0))
    }

    #[test]
    fn smoothed_noise_hangs_together_and_white_noise_and_motion_do_not() {
        let white: Vec<f64> = noise(1.0, 12_000).collect();
        let ramp = |k: usize| 0.02 * (k as f64 - 6000.0).abs();
        let of =
            |x: &[f64]| samples_together(&x.iter().enumerate().map(|(k, x)| x + ramp(k)).collect::<Vec<_>>());
        assert_eq!(of(&white), 1);
        // Running means over w: sums of w that follow each other have nothing in common.
        for w in [8, 21, 40] {
            let mean: Vec<f64> = white.windows(w).map(|x| x.iter().sum::<f64>() / w as f64).collect();
            assert!((0.6..1.5).contains(&(of(&mean) as f64 / w as f64)), "{w}: {}", of(&mean));
            let found = from_second_differences(&mean).unwrap() * (w as f64).sqrt();
            assert!((0.85..1.15).contains(&found), "{w}: {found}");
        }
        // A low-pass of first order: as independent as a correlation of 0.16 after 1.9 of its times.
        let mut low = 0.0;
        let passed: Vec<f64> = white
            .iter()
            .map(|x| {
                low += (x - low) / 10.0;
                low
            })
            .collect();
        assert!((12..30).contains(&of(&passed)), "{}", of(&passed));
        // Speeds that noise drives, and motion that is read without noise.
        let mut sum = 0.0;
        let walk: Vec<f64> = white
            .iter()
            .map(|x| {
                sum += x;
                sum
            })
            .collect();
        assert_eq!(of(&walk), 1);
        let swing: Vec<f64> = (0..12_000).map(|k| (0.05 * k as f64).sin()).collect();
        assert_eq!(of(&swing), 1);
        assert_eq!(of(&[0.0; 10]), 1);
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
