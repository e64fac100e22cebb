//! Cubic B-splines on equal intervals, open or periodic.

/// Intervals of a curve.
const INTERVALS: usize = 12;
/// Number of functions that are non-zero at a point.
pub(super) const SUPPORT: usize = 4;

/// A basis of smooth curves from `low` to `high`, with that period if `periodic`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Basis {
    pub low: f64,
    pub high: f64,
    pub periodic: bool,
}

impl Basis {
    /// Number of functions.
    pub fn len(&self) -> usize {
        if self.periodic { INTERVALS } else { INTERVALS + SUPPORT - 1 }
    }

    /// Index and value of the functions that are non-zero at `x`. Beyond an open range, those at its end.
    pub fn at(&self, x: f64) -> [(usize, f64); SUPPORT] {
        let mut place = (x - self.low) / (self.high - self.low) * INTERVALS as f64;
        if self.periodic {
            place = place.rem_euclid(INTERVALS as f64);
        }
        let interval = (place.floor().max(0.0) as usize).min(INTERVALS - 1);
        let u = (place - interval as f64).clamp(0.0, 1.0);
        let v = 1.0 - u;
        let values = [
            v * v * v / 6.0,
            (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
            (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0,
            u * u * u / 6.0,
        ];
        std::array::from_fn(|k| ((interval + k) % self.len(), values[k]))
    }

    /// Rows of second differences of the coefficients: indices with weights 1, -2, 1.
    pub fn second_differences(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let n = self.len();
        (0..if self.periodic { n } else { n - 2 }).map(move |i| [i, (i + 1) % n, (i + 2) % n])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_sum_to_one_and_reproduce_a_line() {
        let basis = Basis { low: -2.0, high: 4.0, periodic: false };
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
        let basis = Basis { low: -std::f64::consts::PI, high: std::f64::consts::PI, periodic: true };
        let value = |x: f64| -> f64 { basis.at(x).iter().map(|(i, b)| b * (*i as f64).sin()).sum() };
        assert!((value(-3.0) - value(-3.0 + std::f64::consts::TAU)).abs() < 1e-12);
        assert_eq!(basis.second_differences().count(), basis.len());
    }
}
