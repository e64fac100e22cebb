//! Cubic B-splines on equal intervals, open or periodic.

/// Intervals of an open curve.
const INTERVALS: usize = 12;
/// Intervals of a periodic curve.
const PERIODIC_INTERVALS: usize = 12;

/// Number of functions that are non-zero at a point.
pub(super) const SUPPORT: usize = 4;

/// A basis of smooth curves over a range.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    low: f64,
    width: f64,
    intervals: usize,
    periodic: bool,
}

impl Basis {
    /// A basis over `low..high`, with period `high - low` if `periodic`.
    pub fn new(low: f64, high: f64, periodic: bool) -> Self {
        let intervals = if periodic { PERIODIC_INTERVALS } else { INTERVALS };
        Self { low, width: (high - low) / intervals as f64, intervals, periodic }
    }

    /// The range.
    pub fn range(&self) -> (f64, f64) {
        (self.low, self.low + self.width * self.intervals as f64)
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        if self.periodic { self.intervals } else { self.intervals + SUPPORT - 1 }
    }

    /// Index and value of the functions that are non-zero at `x`. Beyond an open range, those at its end.
    pub fn at(&self, x: f64) -> [(usize, f64); SUPPORT] {
        let mut place = (x - self.low) / self.width;
        if self.periodic {
            place = place.rem_euclid(self.intervals as f64);
        }
        let interval = (place.floor().max(0.0) as usize).min(self.intervals - 1);
        let u = (place - interval as f64).clamp(0.0, 1.0);
        let v = 1.0 - u;
        let values = [
            v * v * v / 6.0,
            (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
            (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0,
            u * u * u / 6.0,
        ];
        let mut functions = [(0, 0.0); SUPPORT];
        for (k, (function, value)) in functions.iter_mut().zip(values).enumerate() {
            let index = interval + k;
            *function = (if self.periodic { index % self.intervals } else { index }, value);
        }
        functions
    }

    /// Rows of second differences of the coefficients: indices with weights 1, -2, 1.
    pub fn second_differences(&self) -> Vec<[usize; 3]> {
        let n = self.len();
        if self.periodic {
            (0..n).map(|i| [i, (i + 1) % n, (i + 2) % n]).collect()
        } else {
            (0..n.saturating_sub(2)).map(|i| [i, i + 1, i + 2]).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_sum_to_one_and_reproduce_a_line() {
        let basis = Basis::new(-2.0, 4.0, false);
        for k in 0..=60 {
            let x = -2.0 + 0.1 * f64::from(k);
            let functions = basis.at(x);
            assert!((functions.iter().map(|(_, b)| b).sum::<f64>() - 1.0).abs() < 1e-12);
            // A line's coefficients are the line at the functions' centres (Marsden's identity).
            let line: f64 = functions.iter().map(|(i, b)| b * (-2.0 + 0.5 * (*i as f64 - 1.0))).sum();
            assert!((line - x).abs() < 1e-12, "{x}: {line}");
        }
    }

    #[test]
    fn a_periodic_basis_closes() {
        let basis = Basis::new(-std::f64::consts::PI, std::f64::consts::PI, true);
        let value = |x: f64| -> f64 { basis.at(x).iter().map(|(i, b)| b * (*i as f64).sin()).sum() };
        assert!((value(-3.0) - value(-3.0 + std::f64::consts::TAU)).abs() < 1e-12);
        assert_eq!(basis.second_differences().len(), basis.len());
    }
}
