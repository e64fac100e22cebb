//! Penalised regression on one quantity, with cross-validation.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Vector3};

use super::basis::{Basis, SUPPORT};
use super::residual::Axes;
use super::variable::Variable;

/// Folds of the cross-validation.
pub(super) const FOLDS: usize = 5;
/// Penalties on bending that are tried, relative to the data's weight per function.
const PENALTIES: [f64; 6] = [1e-3, 1e-2, 1e-1, 1.0, 1e2, 1e4];
/// Small ridge that keeps functions without data at zero, relative to the data's weight.
const RIDGE: f64 = 1e-9;
/// An angle that varies by less than this share of a turn is constant, and by more than that covers it.
const TURN: (f64, f64) = (0.05, 0.9);

/// Curves for three axes.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub basis: Basis,
    /// Drop of the whitened sum of squares on data left out of the fit, per axis.
    pub explained: [f64; 3],
    /// Coefficients of each axis' curve from all of the data, and their covariance.
    pub curves: [Option<(DVector<f64>, DMatrix<f64>)>; 3],
}

/// Normal equations of one axis.
#[derive(Debug, Clone)]
struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    squares: f64,
}

impl Normal {
    fn add(&mut self, functions: &[(usize, f64); SUPPORT], value: f64, weight: f64) {
        for (i, a) in functions {
            self.right[*i] += weight * a * value;
            for (j, b) in functions {
                self.matrix[(*i, *j)] += weight * a * b;
            }
        }
        self.squares += weight * value * value;
    }

    /// With those of others added or, with a factor of -1, taken away.
    fn with(mut self, factor: f64, other: &Self) -> Self {
        self.matrix += &other.matrix * factor;
        self.right += &other.right * factor;
        self.squares += other.squares * factor;
        self
    }

    /// Residual sum of squares of these coefficients.
    fn left(&self, coefficients: &DVector<f64>) -> f64 {
        self.squares - 2.0 * self.right.dot(coefficients) + coefficients.dot(&(&self.matrix * coefficients))
    }

    /// The factor of the matrix with a penalty on bending; `None` where there are no data.
    fn penalised(&self, basis: &Basis, penalty: f64) -> Option<Cholesky<f64, Dyn>> {
        let weight = self.matrix.trace() / basis.len() as f64;
        let mut matrix = self.matrix.clone();
        for row in basis.second_differences() {
            for (i, a) in row.iter().zip([1.0, -2.0, 1.0]) {
                for (j, b) in row.iter().zip([1.0, -2.0, 1.0]) {
                    matrix[(*i, *j)] += penalty * weight * a * b;
                }
            }
        }
        for i in 0..basis.len() {
            matrix[(i, i)] += RIDGE * weight.max(f64::MIN_POSITIVE);
        }
        matrix.cholesky()
    }
}

/// The basis over which a quantity is regressed on; `None` if it hardly varies or is not finite.
pub(super) fn basis(variable: &Variable) -> Option<Basis> {
    let others = variable.of_other_axes.iter().flatten().flatten();
    let mut sorted: Vec<f64> = variable.value.iter().chain(others).copied().collect();
    if sorted.iter().any(|x| !x.is_finite()) {
        return None;
    }
    sorted.sort_by(f64::total_cmp);
    // Without the outermost 0.1 % at either end: outliers must not stretch the range.
    let cut = if variable.period.is_some() { 0 } else { sorted.len() / 500 };
    let (low, high) = (*sorted.get(cut)?, *sorted.get(sorted.len() - 1 - cut)?);
    match variable.period {
        Some(period) if high - low < TURN.0 * period => return None,
        // One that does not cover a full turn is treated as an ordinary number.
        Some(period) if high - low > TURN.1 * period => {
            return Some(Basis { low: -0.5 * period, high: 0.5 * period, periodic: true });
        }
        _ => {}
    }
    let scale = low.abs().max(high.abs());
    let varies = high - low > 1e-9 * scale && high - low > variable.resolution;
    varies.then_some(Basis { low, high, periodic: false })
}

/// Chooses the smoothness of each axis' curve, by its score on the folds that were left out.
pub(super) fn fit(basis: Basis, variable: &Variable, axes: &Axes, folds: &[usize]) -> Fit {
    let mut fit = Fit { basis, explained: [0.0; 3], curves: [None, None, None] };
    let n = basis.len();
    let none = Normal { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n), squares: 0.0 };
    for (i, axis) in axes.iter().enumerate() {
        let mut parts = vec![none.clone(); FOLDS];
        for ((x, (value, sigma)), fold) in variable.of_axis(i).iter().zip(axis).zip(folds) {
            if let Some(part) = parts.get_mut(*fold) {
                part.add(&basis.at(*x), *value, sigma.powi(-2));
            }
        }
        let all = parts.iter().fold(none.clone(), |all, part| all.with(1.0, part));
        let left = |penalty: f64| -> f64 {
            let left = parts.iter().map(|part| {
                let others = all.clone().with(-1.0, part);
                let factor = others.penalised(&basis, penalty);
                factor.map_or(part.squares, |factor| part.left(&factor.solve(&others.right)))
            });
            left.sum()
        };
        let tried = PENALTIES.map(|penalty| (left(penalty), penalty));
        let Some((left, penalty)) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        fit.explained[i] = all.squares - left;
        // The covariance grows where the scatter is larger than the stated noise.
        fit.curves[i] = all.penalised(&basis, penalty).map(|factor| {
            let coefficients = factor.solve(&all.right);
            let inflation = (all.left(&coefficients) / axis.len() as f64).max(1.0);
            (coefficients, factor.inverse() * inflation)
        });
    }
    fit
}

/// Drop of the whitened sum of squares by a constant vector, on data left out of its fit: of axes, (value, standard deviation) each, that
/// see the vector along a direction, by axis and place.
pub(super) fn constant_explains(
    axes: &[&Vec<(f64, f64)>],
    direction: &dyn Fn(usize, usize) -> Vector3<f64>,
    folds: &[usize],
) -> f64 {
    // Per fold: normal equations.
    let mut sums = [(Matrix3::zeros(), Vector3::zeros()); FOLDS];
    for (i, axis) in axes.iter().enumerate() {
        for (k, ((value, sigma), fold)) in axis.iter().zip(folds).enumerate() {
            let Some(sum) = sums.get_mut(*fold) else { continue };
            let (direction, weight) = (direction(i, k), sigma.powi(-2));
            sum.0 += direction * direction.transpose() * weight;
            sum.1 += direction * (weight * value);
        }
    }
    let all = sums.iter().fold((Matrix3::zeros(), Vector3::zeros()), |all, of| (all.0 + of.0, all.1 + of.1));
    let ridge = Matrix3::from_diagonal_element(f64::EPSILON * all.0.trace());
    let explains = |(matrix, right): &(Matrix3<f64>, Vector3<f64>)| {
        let constant = (all.0 - matrix + ridge).cholesky()?.solve(&(all.1 - right));
        Some(2.0 * constant.dot(right) - constant.dot(&(matrix * constant)))
    };
    sums.iter().filter_map(explains).sum()
}
