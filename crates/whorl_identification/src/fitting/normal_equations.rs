//! Normal equations, and normal fits to some of their columns with priors: linear algebra on values.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use whorl_prediction::{Hints, Parameter};

/// log p of a change x of columns is `vector . x - x . matrix x / 2` more.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub matrix: DMatrix<f64>,
    pub vector: DVector<f64>,
}

impl Normal {
    pub fn zeros(columns: usize) -> Self {
        Self { matrix: DMatrix::zeros(columns, columns), vector: DVector::zeros(columns) }
    }

    /// What recordings say about parameters that are at these values, the slope of their priors included, so that the priors of changes
    /// are about no change.
    pub fn about(hints: &[Hints], at: &[f64], parameters: &[Parameter]) -> Self {
        let size = hints.first().map_or(0, |of_run| of_run.slope.len());
        let mut normal = Self::zeros(size);
        for of_run in hints {
            normal.matrix += &of_run.information;
            normal.vector += &of_run.slope;
        }
        for (i, (units, parameter)) in at.iter().zip(parameters).enumerate() {
            normal.vector[i] -= units / parameter.stddev.powi(2);
        }
        normal
    }

    pub fn add(&mut self, other: &Self, factor: f64) {
        self.matrix += &other.matrix * factor;
        self.vector += &other.vector * factor;
    }
}

/// A normal fit of some columns.
#[derive(Debug, Clone)]
pub(crate) struct Estimate {
    /// Columns in it.
    pub active: Vec<usize>,
    /// Their values, in their units.
    pub value: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Log evidence over that without any change.
    pub log_evidence: f64,
    /// Drop of twice the negative log posterior.
    pub drop: f64,
}

impl Estimate {
    /// Posterior mean and evidence of `active` columns with prior variances.
    pub fn new(normal: &Normal, active: &[usize], variance: impl Fn(usize) -> f64) -> Option<Self> {
        let size = active.len();
        let variances: Vec<f64> = active.iter().map(|i| variance(*i)).collect();
        let mut posterior = DMatrix::zeros(size, size);
        let mut vector = DVector::zeros(size);
        for (a, i) in active.iter().enumerate() {
            for (b, j) in active.iter().enumerate() {
                posterior[(a, b)] = normal.matrix[(*i, *j)];
            }
            posterior[(a, a)] += 1.0 / variances[a];
            vector[a] = normal.vector[*i];
        }
        let factor = Cholesky::new(posterior)?;
        let value = factor.solve(&vector);
        let drop = value.dot(&vector);
        let log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>()
            + variances.iter().map(|v| v.ln()).sum::<f64>();
        let log_evidence = 0.5 * drop - 0.5 * log_determinant;
        log_evidence.is_finite().then(|| Self { active: active.to_vec(), value, factor, log_evidence, drop })
    }

    /// Covariance of the values.
    pub fn covariance(&self) -> DMatrix<f64> {
        self.factor.inverse()
    }

    /// Value of a column; 0 if it is not in the fit.
    pub fn of(&self, column: usize) -> f64 {
        self.active.iter().position(|i| *i == column).map_or(0.0, |a| self.value[a])
    }

    /// All values over all columns.
    pub fn spread(&self, columns: usize) -> DVector<f64> {
        let mut all = DVector::zeros(columns);
        for (a, i) in self.active.iter().enumerate() {
            all[*i] = self.value[a];
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_is_the_density_of_the_data() {
        // One column of ones over two rows, y = (1, 2), prior variance 4: y ~ N(0, I + 4 11^T).
        let mut normal = Normal::zeros(1);
        normal.matrix[(0, 0)] = 2.0;
        normal.vector[0] = 3.0;
        let estimate = Estimate::new(&normal, &[0], |_| 4.0).unwrap();
        // det = 9, y^T C^-1 y = 5 - 4/9 * 9 = 1; noise alone: 5.
        let expected = -0.5 * 9f64.ln() - 0.5 + 2.5;
        assert!((estimate.log_evidence - expected).abs() < 1e-12);
    }
}
