//! Penalised regression on one quantity, with cross-validation.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::basis::{Basis, SUPPORT};
use super::variable::Variable;

/// Folds of the cross-validation.
pub(super) const FOLDS: usize = 5;
/// Penalties on bending that are tried, relative to the data's weight per function.
const PENALTIES: [f64; 6] = [1e-3, 1e-2, 1e-1, 1.0, 1e2, 1e4];
/// Small ridge that keeps functions without data at zero, relative to the data's weight.
const RIDGE: f64 = 1e-9;

/// A quantity, ready to be regressed on.
#[derive(Debug, Clone)]
pub(super) struct Regression {
    pub basis: Basis,
    variable: Variable,
    pub periodic: bool,
    folds: Vec<usize>,
}

/// Curves for three axes.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Drop of the whitened sum of squares on data left out of the fit, per axis.
    pub explained: [f64; 3],
    /// Penalty chosen for each axis.
    pub penalty: [f64; 3],
}

impl Fit {
    pub fn explained_total(&self) -> f64 {
        self.explained.iter().sum()
    }
}

/// Normal equations of one axis.
#[derive(Debug, Clone)]
struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    squares: f64,
}

impl Normal {
    fn zero(n: usize) -> Self {
        Self { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n), squares: 0.0 }
    }

    fn add(&mut self, functions: &[(usize, f64); SUPPORT], value: f64, weight: f64) {
        for (i, a) in functions {
            self.right[*i] += weight * a * value;
            for (j, b) in functions {
                self.matrix[(*i, *j)] += weight * a * b;
            }
        }
        self.squares += weight * value * value;
    }

    /// Residual sum of squares of these coefficients.
    fn left(&self, coefficients: &DVector<f64>) -> f64 {
        self.squares - 2.0 * self.right.dot(coefficients) + coefficients.dot(&(&self.matrix * coefficients))
    }
}

impl Regression {
    /// `None` if the quantity hardly varies or is not finite.
    pub fn new(variable: &Variable, folds: &[usize]) -> Option<Self> {
        let others = variable.of_other_axes.iter().flatten().flatten();
        let mut sorted: Vec<f64> = variable.value.iter().chain(others).copied().collect();
        if sorted.iter().any(|x| !x.is_finite()) {
            return None;
        }
        sorted.sort_by(f64::total_cmp);
        let (low, high, periodic) = match variable.period {
            Some(period) => {
                let spread = sorted.last()? - sorted.first()?;
                if spread < 0.05 * period {
                    return None;
                }
                // An angle that does not cover a full turn is treated as an ordinary number.
                if spread > 0.9 * period {
                    (-0.5 * period, 0.5 * period, true)
                } else {
                    (*sorted.first()?, *sorted.last()?, false)
                }
            }
            // Without the outermost 0.1 % at either end: outliers must not stretch the range.
            None => {
                let cut = sorted.len() / 500;
                (*sorted.get(cut)?, *sorted.get(sorted.len() - 1 - cut)?, false)
            }
        };
        let scale = low.abs().max(high.abs());
        if !(high - low > 1e-9 * scale && high - low > variable.resolution) {
            return None;
        }
        Some(Self {
            basis: Basis::new(low, high, periodic),
            variable: variable.clone(),
            periodic,
            folds: folds.to_vec(),
        })
    }

    fn normal(&self, i: usize, axis: &[(f64, f64)], fold: impl Fn(usize) -> bool) -> Normal {
        let mut normal = Normal::zero(self.basis.len());
        for ((x, (value, sigma)), at) in self.variable.of_axis(i).iter().zip(axis).zip(&self.folds) {
            if fold(*at) {
                normal.add(&self.basis.at(*x), *value, sigma.powi(-2));
            }
        }
        normal
    }

    /// Chooses the smoothness of each axis' curve and computes its score.
    pub fn fit(&self, axes: &[Vec<(f64, f64)>; 3]) -> Fit {
        let mut fit = Fit { explained: [0.0; 3], penalty: [1.0; 3] };
        let scores = fit.explained.iter_mut().zip(&mut fit.penalty);
        for ((i, axis), (explained, penalty)) in axes.iter().enumerate().zip(scores) {
            let parts: Vec<Normal> = (0..FOLDS).map(|k| self.normal(i, axis, |fold| fold == k)).collect();
            let total = parts.iter().map(|p| p.squares).sum::<f64>();
            let mut best = f64::INFINITY;
            for &candidate in &PENALTIES {
                let left: f64 = (0..FOLDS)
                    .map(|k| {
                        let mut others = Normal::zero(self.basis.len());
                        for (_, part) in parts.iter().enumerate().filter(|(j, _)| *j != k) {
                            others.matrix += &part.matrix;
                            others.right += &part.right;
                        }
                        let solved = self.solve(&others, candidate);
                        parts.get(k).map_or(0.0, |part| part.left(&solved))
                    })
                    .sum();
                if left < best {
                    best = left;
                    *penalty = candidate;
                }
            }
            *explained = total - best;
        }
        fit
    }

    fn penalised(&self, normal: &Normal, penalty: f64) -> DMatrix<f64> {
        let weight = normal.matrix.trace() / self.basis.len() as f64;
        let mut matrix = normal.matrix.clone();
        for row in self.basis.second_differences() {
            for (i, a) in row.iter().zip([1.0, -2.0, 1.0]) {
                for (j, b) in row.iter().zip([1.0, -2.0, 1.0]) {
                    matrix[(*i, *j)] += penalty * weight * a * b;
                }
            }
        }
        for i in 0..self.basis.len() {
            matrix[(i, i)] += RIDGE * weight.max(f64::MIN_POSITIVE);
        }
        matrix
    }

    fn solve(&self, normal: &Normal, penalty: f64) -> DVector<f64> {
        self.penalised(normal, penalty)
            .cholesky()
            .map_or_else(|| DVector::zeros(self.basis.len()), |factor| factor.solve(&normal.right))
    }

    /// The curve of one axis from all of the data: its coefficients and their covariance. `inflation`
    /// multiplies the covariance: the ratio of the residual scatter to the stated noise, at least one.
    pub fn curve(&self, i: usize, axis: &[(f64, f64)], penalty: f64) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let normal = self.normal(i, axis, |_| true);
        let factor = self.penalised(&normal, penalty).cholesky()?;
        let coefficients = factor.solve(&normal.right);
        let inflation = (normal.left(&coefficients) / axis.len() as f64).max(1.0);
        Some((coefficients, factor.inverse() * inflation))
    }
}

/// Drop of the whitened sum of squares by a constant, on data left out of its fit.
pub(super) fn constant_explains(axis: &[(f64, f64)], folds: &[usize]) -> f64 {
    // Per fold: weights, weighted sum.
    let mut sums = [(0.0, 0.0); FOLDS];
    for ((value, sigma), fold) in axis.iter().zip(folds) {
        if let Some(sum) = sums.get_mut(*fold) {
            let weight = sigma.powi(-2);
            sum.0 += weight;
            sum.1 += weight * value;
        }
    }
    let (weight, weighted) = sums.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    sums.iter()
        .map(|(w, s)| {
            let constant = (weighted - s) / (weight - w).max(f64::MIN_POSITIVE);
            2.0 * constant * s - constant * constant * w
        })
        .sum()
}

/// The same by a torque that is constant in the world, of one in body axes.
pub(super) fn constant_in_world_explains(
    body: &[Vec<(f64, f64)>; 3],
    r_world_body: &[Matrix3<f64>],
    folds: &[usize],
) -> f64 {
    // Per fold: normal equations.
    let mut sums = [(Matrix3::zeros(), Vector3::zeros()); FOLDS];
    for (i, axis) in body.iter().enumerate() {
        for (((value, sigma), r), fold) in axis.iter().zip(r_world_body).zip(folds) {
            let (Some(sum), weight) = (sums.get_mut(*fold), sigma.powi(-2)) else { continue };
            // About this body axis it is the product with that axis in the world.
            let axis_w = r.column(i).into_owned();
            sum.0 += axis_w * axis_w.transpose() * weight;
            sum.1 += axis_w * (weight * value);
        }
    }
    let all = sums.iter().fold((Matrix3::zeros(), Vector3::zeros()), |all, of| (all.0 + of.0, all.1 + of.1));
    let explains = |(matrix, right): &(Matrix3<f64>, Vector3<f64>)| {
        let others = (all.0 - matrix).cholesky()?;
        let constant = others.solve(&(all.1 - right));
        Some(2.0 * constant.dot(right) - constant.dot(&(matrix * constant)))
    };
    sums.iter().filter_map(explains).sum()
}
