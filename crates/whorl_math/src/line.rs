//! Straight lines by least squares: value and slope from neighbouring samples.

use std::iter::Sum;
use std::ops::{Add, Mul};

/// Values that a line can be fitted to: numbers and vectors.
pub trait Value: Copy + Add<Output = Self> + Mul<f64, Output = Self> + Sum {}
impl<T: Copy + Add<Output = T> + Mul<f64, Output = T> + Sum> Value for T {}

/// A straight line through samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line<T> {
    /// Weighted mean of the abscissae, where the line's value has the smallest variance.
    pub centre: f64,
    /// Value at `centre`.
    pub mean: T,
    /// Change per unit of the abscissa; zero if all abscissae are equal.
    pub slope: T,
    /// Sum of weight times squared distance from the centre. If weights are inverse variances, its inverse is the variance
    /// of the slope.
    pub spread: f64,
}

impl<T: Value> Line<T> {
    /// Fit to samples of equal weight; `None` without samples.
    pub fn through(samples: impl IntoIterator<Item = (f64, T), IntoIter: Clone>) -> Option<Self> {
        Self::weighted(samples.into_iter().map(|(x, y)| (x, y, 1.0)))
    }

    /// Fit to samples of abscissa, value, weight; `None` if the weights are zero.
    pub fn weighted(samples: impl IntoIterator<Item = (f64, T, f64), IntoIter: Clone>) -> Option<Self> {
        let samples = samples.into_iter();
        let total: f64 = samples.clone().map(|(_, _, w)| w).sum();
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        let centre = samples.clone().map(|(x, _, w)| w * x).sum::<f64>() / total;
        let mean = samples.clone().map(|(_, y, w)| y * (w / total)).sum::<T>();
        let spread: f64 = samples.clone().map(|(x, _, w)| w * (x - centre).powi(2)).sum();
        let per = if spread > 0.0 { spread.recip() } else { 0.0 };
        let slope = samples.map(|(x, y, w)| y * (w * (x - centre) * per)).sum();
        Some(Self { centre, mean, slope, spread })
    }

    /// The line's value at an abscissa.
    pub fn at(&self, x: f64) -> T {
        self.mean + self.slope * (x - self.centre)
    }
}

impl Line<f64> {
    /// What is left of the samples (abscissa, value, inverse variance) over their deviations, root mean square with two numbers fitted:
    /// Birge's ratio. 1 where no more than these two were sampled.
    pub fn scatter(&self, samples: impl IntoIterator<Item = (f64, f64, f64)>) -> f64 {
        let square = |(x, y, w): (f64, f64, f64)| w * (y - self.at(x)).powi(2);
        let squares: Vec<f64> = samples.into_iter().map(square).collect();
        if squares.len() <= 2 {
            1.0
        } else {
            (squares.iter().sum::<f64>() / (squares.len() - 2) as f64).sqrt()
        }
    }
}

/// Indices of the samples within `half_width_s` of a time.
#[must_use]
pub fn window(times_s: &[f64], time_s: f64, half_width_s: f64) -> std::ops::Range<usize> {
    let first = times_s.partition_point(|t| *t < time_s - half_width_s);
    first..times_s.partition_point(|t| *t <= time_s + half_width_s).max(first)
}

/// The line through the samples within `half_width_s` of a time; `None` where there are none.
pub fn local_line<T: Value>(
    times_s: &[f64],
    value: impl Fn(usize) -> T,
    time_s: f64,
    half_width_s: f64,
) -> Option<Line<T>> {
    let samples = window(times_s, time_s, half_width_s).filter_map(|k| times_s.get(k).map(|t| (*t, k)));
    Line::through(samples.map(|(t, k)| (t, value(k))).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn a_line_is_reproduced_also_at_the_ends() {
        let times: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
        for at in [0.0, 0.3, 0.99] {
            let line = local_line(&times, |k| Vector2::new(2.0 - 3.0 * times[k], 1.0), at, 0.1).unwrap();
            let found = line.at(at);
            assert!((found - Vector2::new(2.0 - 3.0 * at, 1.0)).norm() < 1e-9, "{at}");
            assert!((line.slope - Vector2::new(-3.0, 0.0)).norm() < 1e-9);
        }
        assert_eq!(local_line(&times, |_| 1.0, 5.0, 0.1), None);
        let one = Line::through([(3.0, 2.0)]).unwrap();
        assert_eq!((one.at(7.0), one.slope), (2.0, 0.0));
    }

    /// The slope computed by hand, and with the heavy sample replaced by four equal ones.
    #[test]
    fn weights_count_as_repeated_samples() {
        let weighted = Line::weighted([(0.0, 1.0, 1.0), (1.0, 3.0, 1.0), (2.0, 4.0, 4.0)]).unwrap();
        let repeated =
            Line::through([(0.0, 1.0), (1.0, 3.0), (2.0, 4.0), (2.0, 4.0), (2.0, 4.0), (2.0, 4.0)]).unwrap();
        assert!((weighted.at(5.0) - repeated.at(5.0)).abs() < 1e-12);
        // sum w = 6, mean x = 1.5, mean y = 10/3, slope = (1.5 * 7/3 + 0.5/3 + 2 * 2/3) / 3.5.
        assert!((weighted.slope - 5.0 / 3.5).abs() < 1e-12, "{weighted:?}");
    }
}
