//! A measured curve: a cubic B-spline whose coefficients are parameters.
//!
//! Natural end: beyond the first and the last knot the curve goes on as a straight line, so that a motion somewhat faster
//! than any that was measured meets no cubic.

use std::ops::Range;

/// Shape that a curve must have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CurveShape {
    /// Any.
    Free,
    /// Never negative: what brakes never pushes.
    Positive,
    /// Never falls: its coefficients are increments, each at least zero, and it begins at zero at the first knot.
    Increasing,
}

/// A cubic B-spline over knots; its coefficients stand in the values from `first` on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spline {
    /// Increasing, at least two.
    knots: Vec<f64>,
    first: usize,
    shape: CurveShape,
}

impl Spline {
    pub fn new(knots: Vec<f64>, first: usize, shape: CurveShape) -> Self {
        Self { knots, first, shape }
    }

    /// Coefficients of a curve with so many knots: one at each knot and one at each end; without the constant where it
    /// must increase from zero.
    pub fn coefficients(knots: usize, shape: CurveShape) -> usize {
        knots + 2 - usize::from(shape == CurveShape::Increasing)
    }

    /// Positions of its coefficients among the values.
    pub fn parameters(&self) -> Range<usize> {
        self.first..self.first + Self::coefficients(self.knots.len(), self.shape)
    }

    /// Its value at `x`, its coefficients in `values`.
    pub fn at(&self, x: f64, values: &[f64]) -> f64 {
        let (Some(&low), Some(&high)) = (self.knots.first(), self.knots.last()) else { return 0.0 };
        let inside = x.clamp(low, high);
        let value = self.inside(inside, values);
        if inside == x {
            return value;
        }
        // Straight on.
        let step = 1e-4 * (high - low);
        let back = if x > high { high - step } else { low + step };
        let slope = (value - self.inside(back, values)) / (inside - back);
        let on = value + slope * (x - inside);
        match self.shape {
            CurveShape::Free => on,
            CurveShape::Positive => on.max(0.0),
            CurveShape::Increasing => {
                if x < low {
                    value
                } else {
                    on
                }
            }
        }
    }

    fn inside(&self, x: f64, values: &[f64]) -> f64 {
        let last = self.knots.len() - 2;
        let span = self.knots.partition_point(|k| *k <= x).saturating_sub(1).min(last);
        let basis = self.basis(span, x);
        let of = |i: usize| values.get(self.first + i).copied().unwrap_or(0.0);
        match self.shape {
            CurveShape::Free | CurveShape::Positive => {
                basis.iter().enumerate().map(|(i, b)| b * of(span + i)).sum()
            }
            // The coefficient is the sum of the increments up to it; the first is zero.
            CurveShape::Increasing => {
                let mut sum: f64 = (0..span).map(of).sum();
                let mut value = basis[0] * sum;
                for (i, b) in basis.iter().enumerate().skip(1) {
                    sum += of(span + i - 1);
                    value += b * sum;
                }
                value
            }
        }
    }

    /// The four cubic functions that are not zero in a span (de Boor 1978, chapter 10), end knots fourfold.
    fn basis(&self, span: usize, x: f64) -> [f64; 4] {
        let last = self.knots.len() - 1;
        // Knot number j of the extended row, three more at each end.
        let knot = |j: isize| {
            let j = j.clamp(0, last as isize) as usize;
            self.knots.get(j).copied().unwrap_or(0.0)
        };
        let span = span as isize;
        let mut basis = [1.0, 0.0, 0.0, 0.0];
        for degree in 1..=3_isize {
            let mut saved = 0.0;
            for r in 0..degree {
                let right = knot(span + r + 1) - x;
                let left = x - knot(span + 1 - (degree - r));
                let share = basis[r as usize] / (right + left);
                basis[r as usize] = saved + right * share;
                saved = left * share;
            }
            basis[degree as usize] = saved;
        }
        basis
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greville's abscissae as coefficients give the straight line, by Marsden's identity (1970).
    #[test]
    fn it_makes_a_straight_line_and_a_constant() {
        let knots = vec![-1.0, 0.0, 0.5, 2.0, 3.0];
        let spline = Spline::new(knots.clone(), 1, CurveShape::Free);
        let extended: Vec<f64> = [-1.0; 3].into_iter().chain(knots.iter().copied()).chain([3.0; 3]).collect();
        let mut values = vec![99.0];
        values.extend((0..7).map(|i| extended[i + 1..i + 4].iter().sum::<f64>() / 3.0));
        assert_eq!(spline.parameters(), 1..8);
        for x in [-2.0, -1.0, -0.3, 0.0, 0.2, 0.5, 1.7, 3.0, 4.0] {
            assert!((spline.at(x, &values) - x).abs() < 1e-9, "{x}: {}", spline.at(x, &values));
        }
        let ones = [99.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
        assert!((spline.at(0.77, &ones) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn shapes_hold_whatever_the_coefficients() {
        let knots = vec![0.0, 0.1, 0.4, 1.0];
        let increasing = Spline::new(knots.clone(), 0, CurveShape::Increasing);
        let positive = Spline::new(knots, 0, CurveShape::Positive);
        let mut state = 3_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        for _ in 0..50 {
            let values: Vec<f64> = (0..6).map(|_| next()).collect();
            assert_eq!(increasing.at(0.0, &values), 0.0);
            let mut last = 0.0;
            for i in 0..150 {
                let x = 0.01 * f64::from(i);
                assert!(positive.at(x, &values) >= 0.0);
                let y = increasing.at(x, &values);
                assert!(y >= last - 1e-12, "{x}: {y} after {last}");
                last = y;
            }
        }
    }
}
