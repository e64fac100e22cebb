//! The curve of a residual over a quantity, and its shape.

use serde::Serialize;

use super::regression::{Fit, Regression};

/// Number of points of a curve.
const PLACES: usize = 41;

/// Symmetry about zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Parity {
    /// f(-x) = -f(x), as friction.
    Odd,
    /// f(-x) = f(x).
    Even,
    /// Neither, or the data lie on only one side of zero.
    None,
}

/// How a curve grows from zero to the end of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Growth {
    /// Saturates, as Coulomb friction.
    Saturates,
    /// In proportion, as viscous friction.
    Linear,
    /// Faster than in proportion, as drag.
    Superlinear,
    /// Undetermined.
    Unclear,
}

/// Residual torque as a curve of a quantity, with its standard deviation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shape {
    /// The quantity.
    pub x: Vec<f64>,
    /// Torque about each axis [N m].
    pub torque_n_m: [Vec<f64>; 3],
    /// Its standard deviation [N m].
    pub stddev_n_m: [Vec<f64>; 3],
    /// Whether the curve closes (an angle).
    pub periodic: bool,
}

impl Shape {
    pub(super) fn of(regression: &Regression, fit: &Fit, axes: &[Vec<(f64, f64)>; 3]) -> Self {
        let (low, high) = regression.basis.range();
        let x: Vec<f64> = (0..PLACES).map(|k| low + (high - low) * k as f64 / (PLACES - 1) as f64).collect();
        let mut shape = Self {
            torque_n_m: [const { Vec::new() }; 3],
            stddev_n_m: [const { Vec::new() }; 3],
            periodic: regression.periodic,
            x,
        };
        for (i, axis) in axes.iter().enumerate() {
            let Some((coefficients, covariance)) = regression.curve(i, axis, fit.penalty[i]) else {
                continue;
            };
            for x in &shape.x {
                let functions = regression.basis.at(*x);
                let value: f64 = functions.iter().map(|(j, b)| b * coefficients[*j]).sum();
                let variance: f64 = functions
                    .iter()
                    .flat_map(|(j, a)| functions.iter().map(move |(k, b)| (*j, *k, a * b)))
                    .map(|(j, k, ab)| ab * covariance[(j, k)])
                    .sum();
                shape.torque_n_m[i].push(value);
                shape.stddev_n_m[i].push(variance.max(0.0).sqrt());
            }
        }
        shape
    }

    /// The axis on which the curve is largest: by its mean square, each place weighted by what is known of it.
    pub(super) fn axis(&self) -> usize {
        let size = |i: usize| {
            let weights = || self.stddev_n_m[i].iter().map(|s| s.max(f64::MIN_POSITIVE).powi(-2));
            let total: f64 = weights().sum();
            let squares: f64 = weights().zip(&self.torque_n_m[i]).map(|(w, v)| w * v * v).sum();
            if total > 0.0 && total.is_finite() { squares / total } else { 0.0 }
        };
        (0..3).max_by(|a, b| size(*a).total_cmp(&size(*b))).unwrap_or(0)
    }

    /// The curve of `axis` at `x`, interpolated linearly.
    fn at(&self, axis: usize, x: f64) -> Option<f64> {
        let curve = self.torque_n_m.get(axis)?;
        let (low, high) = (*self.x.first()?, *self.x.last()?);
        let place = (x - low) / (high - low) * (self.x.len() - 1) as f64;
        let first = (place.floor().max(0.0) as usize).min(self.x.len().saturating_sub(2));
        let (a, b) = (curve.get(first)?, curve.get(first + 1)?);
        Some(a + (b - a) * (place - first as f64))
    }

    /// How far the data reach to both sides of zero; `None` if one side is under half of the other.
    fn both_sides(&self) -> Option<f64> {
        let (low, high) = (*self.x.first()?, *self.x.last()?);
        let reach = high.min(-low);
        (reach > 0.0 && reach >= 0.5 * high.max(-low)).then_some(reach)
    }

    /// Symmetry of the curve of an axis (0, 1, 2).
    #[must_use]
    pub fn parity(&self, axis: usize) -> Parity {
        let Some(reach) = self.both_sides() else { return Parity::None };
        let (mut odd, mut even) = (0.0, 0.0);
        for k in 1..=20 {
            let x = reach * f64::from(k) / 20.0;
            let (Some(right), Some(left)) = (self.at(axis, x), self.at(axis, -x)) else {
                return Parity::None;
            };
            odd += (0.5 * (right - left)).powi(2);
            even += (0.5 * (right + left)).powi(2);
        }
        match odd / (odd + even) {
            share if share > 0.8 => Parity::Odd,
            share if share < 0.2 => Parity::Even,
            _ => Parity::None,
        }
    }

    /// How the curve of an axis grows from zero: its odd part where the data lie on both sides of zero,
    /// else the curve itself if the data begin near zero.
    #[must_use]
    pub fn growth(&self, axis: usize) -> Growth {
        if self.periodic {
            return Growth::Unclear;
        }
        let (Some(low), Some(high)) = (self.x.first(), self.x.last()) else { return Growth::Unclear };
        let value = |x: f64| match self.both_sides() {
            Some(_) => Some(0.5 * (self.at(axis, x)? - self.at(axis, -x)?)),
            None if low.abs() < 0.2 * high.abs() => self.at(axis, x),
            None if high.abs() < 0.2 * low.abs() => self.at(axis, -x),
            None => None,
        };
        let reach = self.both_sides().unwrap_or(high.abs().max(low.abs()));
        let (Some(half), Some(full)) = (value(0.45 * reach), value(0.9 * reach)) else {
            return Growth::Unclear;
        };
        match full / half {
            ratio if (0.5..1.45).contains(&ratio) => Growth::Saturates,
            ratio if (1.6..2.5).contains(&ratio) => Growth::Linear,
            ratio if ratio >= 2.7 => Growth::Superlinear,
            _ => Growth::Unclear,
        }
    }
}
