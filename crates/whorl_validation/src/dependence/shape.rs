//! The curve of a residual over a quantity, and its shape.

use serde::Serialize;

use super::regression::Fit;

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
    pub(super) fn of(fit: &Fit) -> Self {
        let (low, high) = (fit.basis.low, fit.basis.high);
        let x: Vec<f64> = (0..PLACES).map(|k| low + (high - low) * k as f64 / (PLACES - 1) as f64).collect();
        let curves = fit.curves.each_ref().map(|curve| {
            let Some((coefficients, covariance)) = curve else { return (Vec::new(), Vec::new()) };
            let at = |x: &f64| {
                let functions = fit.basis.at(*x);
                let variance_with =
                    |j: usize| functions.iter().map(|(k, b)| b * covariance[(j, *k)]).sum::<f64>();
                let variance: f64 = functions.iter().map(|(j, a)| a * variance_with(*j)).sum();
                let value: f64 = functions.iter().map(|(j, b)| b * coefficients[*j]).sum();
                (value, variance.max(0.0).sqrt())
            };
            x.iter().map(at).unzip()
        });
        let periodic = fit.basis.periodic;
        let [a, b, c] = curves;
        Self { torque_n_m: [a.0, b.0, c.0], stddev_n_m: [a.1, b.1, c.1], periodic, x }
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

    /// The curve at a place on both sides of zero.
    fn both(&self, axis: usize, x: f64) -> Option<(f64, f64)> {
        self.at(axis, x).zip(self.at(axis, -x))
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
        for (right, left) in (1..=20).filter_map(|k| self.both(axis, reach * f64::from(k) / 20.0)) {
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
        let (Some(low), Some(high), false) = (self.x.first(), self.x.last(), self.periodic) else {
            return Growth::Unclear;
        };
        let reach = self.both_sides();
        let value = |share: f64| match reach {
            Some(reach) => self.both(axis, share * reach).map(|(right, left)| 0.5 * (right - left)),
            None if low.abs() < 0.2 * high.abs() || high.abs() < 0.2 * low.abs() => {
                self.at(axis, share * if high.abs() > low.abs() { *high } else { *low })
            }
            None => None,
        };
        match value(0.9).zip(value(0.45)).map(|(full, half)| full / half) {
            Some(ratio) if (0.5..1.45).contains(&ratio) => Growth::Saturates,
            Some(ratio) if (1.6..2.5).contains(&ratio) => Growth::Linear,
            Some(ratio) if ratio >= 2.7 => Growth::Superlinear,
            _ => Growth::Unclear,
        }
    }
}
