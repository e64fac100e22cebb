//! Normal equations of a likelihood, and normal fits to some of their columns with priors.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// log p of a change x of columns is `vector . x - x . matrix x / 2` more.
#[derive(Debug, Clone)]
pub struct Normal {
    /// Symmetric, a row and a column for each column.
    pub matrix: DMatrix<f64>,
    /// As long.
    pub vector: DVector<f64>,
}

impl Normal {
    /// That says nothing of so many columns.
    pub fn zeros(columns: usize) -> Self {
        Self { matrix: DMatrix::zeros(columns, columns), vector: DVector::zeros(columns) }
    }

    /// Share of what a change of these columns does that a change of others follows.
    pub fn followed(
        &self,
        columns: &[usize],
        step: impl Fn(usize) -> f64,
        others: &[usize],
        variance: impl Fn(usize) -> f64,
    ) -> f64 {
        let mut done = DVector::zeros(self.vector.len());
        columns.iter().for_each(|i| done += self.matrix.column(*i) * step(*i));
        let alone: f64 = columns.iter().map(|i| step(*i) * done[*i]).sum();
        let signal = Self { vector: done, matrix: self.matrix.clone() };
        let followed = Estimate::new(&signal, others, variance).map_or(0.0, |of| of.drop);
        if alone > 0.0 { (followed / alone).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Some columns where they are likeliest, the others at 0.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// Which they are,
    pub active: Vec<usize>,
    /// and their values, in this order.
    pub value: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Log evidence over that without any change.
    pub log_evidence: f64,
    /// Drop of twice the negative log posterior.
    pub drop: f64,
}

impl Estimate {
    /// Posterior mean and evidence of `active` columns with prior variances; `None` where the posterior has none.
    pub fn new(normal: &Normal, active: &[usize], variance: impl Fn(usize) -> f64) -> Option<Self> {
        let variances: Vec<f64> = active.iter().map(|i| variance(*i)).collect();
        let n = active.len();
        let mut posterior = DMatrix::from_fn(n, n, |a, b| normal.matrix[(active[a], active[b])]);
        variances.iter().enumerate().for_each(|(a, variance)| posterior[(a, a)] += variance.recip());
        let vector = normal.vector.select_rows(active);
        let factor = Cholesky::new(posterior)?;
        let value = factor.solve(&vector);
        let drop = value.dot(&vector);
        let log_determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum::<f64>()
            + variances.iter().map(|v| v.ln()).sum::<f64>();
        let log_evidence = 0.5 * drop - 0.5 * log_determinant;
        log_evidence.is_finite().then(|| Self { active: active.to_vec(), value, factor, log_evidence, drop })
    }

    /// Posterior covariance, in the order of the active columns.
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
        self.active.iter().zip(&self.value).for_each(|(i, value)| all[*i] = *value);
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
