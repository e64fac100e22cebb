//! The whitened regression: normal equations by blocks of time, coloured noise, evidence.

use std::sync::{Mutex, PoisonError};

use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, DVectorView, Dyn};
use whorl_recording::Component;

use crate::evidence::ar_noise::{ArModel, rows_by_reading, whiten_series};
use crate::whitening::columns::{LANES, Lanes};

/// Blocks of time into which each run is cut for cross-validation.
pub(crate) const BLOCKS_PER_RUN: usize = 4;

/// Rows that enter the normal equations at once.
const STRETCH: usize = 256;

/// Columns whose products with all columns before them are taken at once.
const BAND: usize = 64;

/// Whitened data of one run.
#[derive(Debug, Default)]
pub(crate) struct Whitened {
    /// Groups of columns, each rows x lanes.
    pub groups: Vec<Vec<Lanes>>,
    pub y: Vec<f64>,
    pub reading: Vec<Component>,
    pub node: Vec<u32>,
    pub nodes: usize,
}

/// Normal equations of some rows.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub matrix: DMatrix<f64>,
    pub vector: DVector<f64>,
    pub sum_of_squares: f64,
    pub rows: f64,
}

impl Normal {
    pub fn zeros(columns: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(columns, columns),
            vector: DVector::zeros(columns),
            sum_of_squares: 0.0,
            rows: 0.0,
        }
    }

    /// Misfit with these values of the columns.
    pub fn misfit_at(&self, values: &DVector<f64>) -> f64 {
        self.sum_of_squares - 2.0 * values.dot(&self.vector) + values.dot(&(&self.matrix * values))
    }

    pub fn add(&mut self, other: &Self, factor: f64) {
        self.matrix += &other.matrix * factor;
        self.vector += &other.vector * factor;
        self.sum_of_squares += factor * other.sum_of_squares;
        self.rows += factor * other.rows;
    }
}

impl Whitened {
    /// Normal equations of each block of time, from every `every`-th stretch of rows.
    pub fn normals(&self, columns: usize, threads: usize, every: usize) -> Vec<Normal> {
        let bounds: Vec<usize> = (0..=BLOCKS_PER_RUN)
            .map(|b| {
                // Rows are in order of time.
                let first = (b * self.nodes.max(1)).div_ceil(BLOCKS_PER_RUN);
                if b == BLOCKS_PER_RUN {
                    self.y.len()
                } else {
                    self.node.partition_point(|node| (*node as usize) < first)
                }
            })
            .collect();
        let pairs: Vec<(usize, usize)> = bounds.iter().copied().zip(bounds.iter().copied().skip(1)).collect();
        crate::threads::map(threads, &pairs, |(from, to)| self.normal_of(*from, *to, columns, every.max(1)))
    }

    /// Normal equations of the rows `from..to`: stretch by stretch, each as a few products of matrices.
    fn normal_of(&self, from: usize, to: usize, columns: usize, every: usize) -> Normal {
        let padded = self.groups.len() * LANES;
        let mut normal = Normal::zeros(padded);
        let mut data = vec![0.0; padded * STRETCH];
        let mut start = from;
        while start < to {
            let end = (start + STRETCH).min(to);
            let count = end - start;
            // The columns of a row of the regression lie side by side.
            for (g, group) in self.groups.iter().enumerate() {
                let lanes = group.get(start..end).unwrap_or(&[]);
                for (row, lanes) in data.chunks_exact_mut(padded).zip(lanes) {
                    let slots = &mut row[g * LANES..(g + 1) * LANES];
                    slots.iter_mut().zip(lanes).for_each(|(slot, x)| *slot = f64::from(*x));
                }
            }
            let data = &data[..padded * count];
            let rows = DMatrixView::from_slice(data, padded, count);
            let y = DVectorView::from_slice(&self.y[start..end], count);
            // Only the lower triangle, a band at a time.
            for first in (0..padded).step_by(BAND) {
                let last = (first + BAND).min(padded);
                let transposed = DMatrixView::from_slice_with_strides(data, count, last, padded, 1);
                normal.matrix.view_mut((first, 0), (last - first, last)).gemm(
                    1.0,
                    &rows.rows(first, last - first),
                    &transposed,
                    1.0,
                );
            }
            normal.vector.gemv(1.0, &rows, &y, 1.0);
            normal.sum_of_squares += y.norm_squared();
            normal.rows += count as f64;
            start += STRETCH * every;
        }
        normal.matrix.fill_upper_triangle_with_lower_triangle();
        normal.matrix = normal.matrix.resize(columns, columns, 0.0);
        normal.vector =
            normal.vector.rows(0, columns.min(padded)).into_owned().resize_vertically(columns, 0.0);
        normal
    }

    /// These columns alone, side by side in groups of their own.
    pub fn selected(&self, columns: &[usize]) -> Vec<Vec<Lanes>> {
        let of_group = |chunk: &[usize]| {
            let mut group = vec![[0.0; LANES]; self.y.len()];
            for (lane, column) in chunk.iter().enumerate() {
                let from = self.groups.get(column / LANES).map_or(&[][..], Vec::as_slice);
                for (slot, lanes) in group.iter_mut().zip(from) {
                    slot[lane] = lanes[column % LANES];
                }
            }
            group
        };
        columns.chunks(LANES).map(of_group).collect()
    }

    /// Residual of a fit.
    pub fn residual(&self, estimate: &DVector<f64>) -> Vec<f64> {
        let mut e = self.y.clone();
        for (g, group) in self.groups.iter().enumerate() {
            let mut factors = [0.0; LANES];
            for (i, factor) in factors.iter_mut().enumerate() {
                *factor = estimate.get(g * LANES + i).copied().unwrap_or(0.0);
            }
            if factors == [0.0; LANES] {
                continue;
            }
            for (slot, lanes) in e.iter_mut().zip(group) {
                *slot -= lanes.iter().zip(&factors).map(|(x, f)| f64::from(*x) * f).sum::<f64>();
            }
        }
        e
    }

    /// Rows of each component that was read, in order of time; components in their own order.
    pub fn rows_by_reading(&self) -> Vec<Vec<usize>> {
        rows_by_reading(self.reading.iter().copied())
    }

    /// Passes everything through the filter of coloured noise.
    pub fn whiten(&mut self, ar_models: &[ArModel], threads: usize) {
        let rows_by_reading = self.rows_by_reading();
        whiten_series(&mut self.y, &rows_by_reading, ar_models);
        let groups: Vec<Mutex<&mut Vec<Lanes>>> = self.groups.iter_mut().map(Mutex::new).collect();
        crate::threads::map(threads, &groups, |group| {
            let mut group = group.lock().unwrap_or_else(PoisonError::into_inner);
            for (rows, ar_model) in rows_by_reading.iter().zip(ar_models) {
                ar_model.whiten(
                    rows,
                    &mut group,
                    |y, x, factor| y.iter_mut().zip(x).for_each(|(y, x)| *y += factor as f32 * x),
                    |y, factor| y.iter_mut().for_each(|y| *y *= factor as f32),
                );
            }
        });
    }
}

/// Some columns of a run's regression, and further ones behind them.
pub(crate) struct Widened {
    pub whitened: Whitened,
    own: usize,
    further: usize,
}

impl Whitened {
    /// The columns `own` of this run, and behind them `count` further ones whose responses, in groups, have yet to take these
    /// AR models.
    pub fn widened(
        &self,
        own: &[usize],
        responses: Vec<Vec<Lanes>>,
        count: usize,
        ar_models: &[ArModel],
        threads: usize,
    ) -> Widened {
        let alike = |groups, y| Self {
            groups,
            y,
            reading: self.reading.clone(),
            node: self.node.clone(),
            nodes: self.nodes,
        };
        let mut further = alike(responses, vec![0.0; self.y.len()]);
        further.whiten(ar_models, threads);
        let mut groups = self.selected(own);
        groups.append(&mut further.groups);
        Widened { whitened: alike(groups, self.y.clone()), own: own.len(), further: count }
    }
}

impl Widened {
    /// Columns, with those that fill the last group of either part.
    pub fn width(&self) -> usize {
        self.own.next_multiple_of(LANES) + self.further.next_multiple_of(LANES)
    }

    /// Normal equations of all columns, filling ones included.
    pub fn normal(&self, threads: usize) -> Normal {
        let mut normal = Normal::zeros(self.width());
        for block in self.whitened.normals(self.width(), threads, 1) {
            normal.add(&block, 1.0);
        }
        normal
    }

    /// Adds normal equations of all columns to those that have no filling ones.
    pub fn add_unfilled(&self, of_run: &Normal, total: &mut Normal) {
        let padded = self.own.next_multiple_of(LANES);
        let place = |i: usize| if i < self.own { i } else { padded + i - self.own };
        for i in 0..self.own + self.further {
            total.vector[i] += of_run.vector[place(i)];
            for j in 0..self.own + self.further {
                total.matrix[(i, j)] += of_run.matrix[(place(i), place(j))];
            }
        }
        total.sum_of_squares += of_run.sum_of_squares;
        total.rows += of_run.rows;
    }
}

/// A Gaussian fit of some columns.
#[derive(Debug, Clone)]
pub(crate) struct Estimate {
    /// Columns in it.
    pub active: Vec<usize>,
    /// Their values, in their units.
    pub value: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Log evidence over that of noise alone.
    pub log_evidence: f64,
    /// Drop of the misfit, penalty of the prior included.
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

    /// Misfit of other data with these values, less that of noise alone.
    pub fn misfit_change(&self, normal: &Normal) -> f64 {
        let mut change = 0.0;
        for (a, i) in self.active.iter().enumerate() {
            change -= 2.0 * self.value[a] * normal.vector[*i];
            for (b, j) in self.active.iter().enumerate() {
                change += self.value[a] * normal.matrix[(*i, *j)] * self.value[b];
            }
        }
        change
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
        normal.sum_of_squares = 5.0;
        let estimate = Estimate::new(&normal, &[0], |_| 4.0).unwrap();
        // det = 9, y^T C^-1 y = 5 - 4/9 * 9 = 1; noise alone: 5.
        let expected = -0.5 * 9f64.ln() - 0.5 + 2.5;
        assert!((estimate.log_evidence - expected).abs() < 1e-12);
    }
}
