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

    /// What recordings say about parameters at these values, the slope of their priors included: priors of changes are about no change.
    pub fn about<'h>(hints: impl IntoIterator<Item = &'h Hints>, at: &[f64], priors: &[Parameter]) -> Self {
        let mut normal = Self::zeros(0);
        for of_run in hints {
            if normal.vector.is_empty() {
                normal = Self::zeros(of_run.slope.len());
            }
            normal.matrix += &of_run.information;
            normal.vector += &of_run.slope;
        }
        for ((slope, units), prior) in normal.vector.iter_mut().zip(at).zip(priors) {
            *slope -= units / prior.stddev.powi(2);
        }
        normal
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

#[derive(Debug, Clone)]
pub(crate) struct Estimate {
    pub active: Vec<usize>,
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
