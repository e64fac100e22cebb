//! Slow errors of signals whose formula is right only to some per cent.
//!
//! A real friction, plenum or motor follows its formula to some per cent, and the error changes slowly. So the signal of
//! every term of a hypothesis, and of every known input (thrust, motor torque), is expected to differ from its formula
//! by a factor 1 + e that is constant over some seconds and drawn anew after them, e ~ N(0, eps^2): model discrepancy
//! (Kennedy and O'Hagan 2001) in proportion to the signal. It is integrated out, so that the misspecification leakage of a
//! slightly wrong formula is not taken for a second effect.
//!
//! In a block of time with whitened signals S (rows x signals), the residual r has the covariance I + eps^2 S S^T. By
//! Woodbury's identity every product a^T b becomes a^T b - a^T S (S^T S + I/eps^2)^-1 S^T b, and the density gains
//! -1/2 ln det(I + eps^2 S^T S).

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::evidence::regression::{Normal, Whitened};
use crate::threads;
use crate::whitening::columns::LANES;

/// A signal: how much of each column makes it up.
pub(crate) type Signal = Vec<(usize, f64)>;

/// Products of signals with each other, with all columns and with the data, over one block of time.
#[derive(Debug, Clone)]
struct Block {
    own: DMatrix<f64>,
    /// signals x columns
    columns: DMatrix<f64>,
    data: DVector<f64>,
}

/// What is needed to integrate over errors of signals.
#[derive(Debug, Clone, Default)]
pub(crate) struct Discrepancy {
    blocks: Vec<Block>,
}

impl Discrepancy {
    /// Products over the blocks of every run; `node_s` is the mean time between nodes of each, and an error stays the same
    /// for `block_s`.
    pub fn new(
        whitened: &[Whitened],
        node_s: &[f64],
        signals: &[Signal],
        columns: usize,
        block_s: f64,
        threads: usize,
    ) -> Self {
        if signals.is_empty() {
            return Self::default();
        }
        let mut work: Vec<(&Whitened, usize, usize)> = Vec::new();
        for (run, node_s) in whitened.iter().zip(node_s) {
            let nodes = (block_s / node_s.max(1e-6)).round().max(1.0) as usize;
            let mut from = 0;
            for block in 1..=run.nodes.div_ceil(nodes) {
                let to = run.node.partition_point(|node| (*node as usize) < block * nodes);
                if to > from {
                    work.push((run, from, to));
                }
                from = to;
            }
        }
        let blocks =
            threads::map(threads, &work, |(run, from, to)| Block::new(run, *from, *to, signals, columns));
        Self { blocks }
    }

    /// The normal equations with errors of this relative size integrated out, and what the log density gains.
    pub fn integrated(&self, normal: &Normal, relative_error: f64) -> (Normal, f64) {
        let mut sum = normal.clone();
        let mut log_density = 0.0;
        if relative_error <= 0.0 {
            return (sum, 0.0);
        }
        let precision = 1.0 / (relative_error * relative_error);
        for block in &self.blocks {
            let signals = block.own.nrows();
            let inner = &block.own + DMatrix::identity(signals, signals) * precision;
            let Some(factor) = Cholesky::new(inner) else { continue };
            let half = factor.l_dirty().diagonal();
            log_density -= half.iter().map(|d| d.ln()).sum::<f64>() - 0.5 * signals as f64 * precision.ln();
            // L^-1 S^T [X y]: the products that are taken away are those of these rows.
            let mut columns = block.columns.clone();
            let mut data = block.data.clone();
            let lower = factor.l();
            if !lower.solve_lower_triangular_mut(&mut columns) || !lower.solve_lower_triangular_mut(&mut data)
            {
                continue;
            }
            sum.matrix.gemm_tr(-1.0, &columns, &columns, 1.0);
            sum.vector.gemv_tr(-1.0, &columns, &data, 1.0);
            sum.sum_of_squares -= data.norm_squared();
        }
        (sum, log_density)
    }
}

impl Block {
    fn new(run: &Whitened, from: usize, to: usize, signals: &[Signal], columns: usize) -> Self {
        let mut block = Self {
            own: DMatrix::zeros(signals.len(), signals.len()),
            columns: DMatrix::zeros(signals.len(), columns),
            data: DVector::zeros(signals.len()),
        };
        // Row by row, the signals first: each is a sum over few columns.
        let mut values = DMatrix::zeros(signals.len(), to - from);
        for (m, signal) in signals.iter().enumerate() {
            for (column, factor) in signal {
                let Some(group) = run.groups.get(column / LANES) else { continue };
                for (slot, lanes) in values.row_mut(m).iter_mut().zip(group.get(from..to).unwrap_or(&[])) {
                    *slot += factor * f64::from(lanes[column % LANES]);
                }
            }
        }
        for (g, group) in run.groups.iter().enumerate() {
            for (lanes, s) in group.get(from..to).unwrap_or(&[]).iter().zip(values.column_iter()) {
                for (lane, x) in lanes.iter().enumerate() {
                    let column = g * LANES + lane;
                    if column < columns {
                        for (m, s) in s.iter().enumerate() {
                            block.columns[(m, column)] += s * f64::from(*x);
                        }
                    }
                }
            }
        }
        for (y, s) in run.y.get(from..to).unwrap_or(&[]).iter().zip(values.column_iter()) {
            block.data.axpy(*y, &s, 1.0);
        }
        block.own = &values * values.transpose();
        block
    }
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::evidence::regression::Estimate;

    /// Against the density of the data written out in full: y ~ N(0, I + X P X^T + eps^2 sum_b S_b S_b^T).
    #[test]
    fn integrating_is_the_density_of_the_data_with_errors() {
        let mut random = Pcg64::new(3, 5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let (rows, nodes, relative_error) = (24_usize, 12_usize, 0.3);
        let columns: Vec<[f64; 2]> = (0..rows).map(|_| [normal(), 2.0 + normal()]).collect();
        let y: Vec<f64> = (0..rows).map(|_| 3.0 * normal()).collect();
        let lanes = |x: &[f64; 2]| std::array::from_fn(|i| x.get(i).copied().unwrap_or(0.0) as f32);
        let group: Vec<[f32; LANES]> = columns.iter().map(lanes).collect();
        let columns: Vec<[f64; 2]> =
            group.iter().map(|lanes| [f64::from(lanes[0]), f64::from(lanes[1])]).collect();
        let run = Whitened {
            groups: vec![group],
            y: y.clone(),
            reading: Vec::new(),
            node: (0..rows as u32).map(|row| row / 2).collect(),
            nodes,
        };
        // Blocks of four nodes, that is of eight rows. The signal is 0.5 of the second column.
        let signals = [vec![(1, 0.5)]];
        let discrepancy = Discrepancy::new(std::slice::from_ref(&run), &[1.25], &signals, 2, 5.0, 1);
        let mut total = Normal::zeros(2);
        for (x, y) in columns.iter().zip(&y) {
            let x = DVector::from_column_slice(x);
            total.matrix += &x * x.transpose();
            total.vector += &x * *y;
            total.sum_of_squares += y * y;
        }
        let (integrated, log_density) = discrepancy.integrated(&total, relative_error);
        let variances = [0.7, 1.9];
        let fit = Estimate::new(&integrated, &[0, 1], |i| variances[i]).unwrap();
        let found = fit.log_evidence - 0.5 * integrated.sum_of_squares + log_density;

        let mut covariance = DMatrix::<f64>::identity(rows, rows);
        for i in 0..rows {
            for j in 0..rows {
                covariance[(i, j)] +=
                    (0..2).map(|c| columns[i][c] * variances[c] * columns[j][c]).sum::<f64>();
                if i / 8 == j / 8 {
                    covariance[(i, j)] += (relative_error * 0.5).powi(2) * columns[i][1] * columns[j][1];
                }
            }
        }
        let factor = Cholesky::new(covariance).unwrap();
        let y = DVector::from_vec(y);
        let expected =
            -0.5 * y.dot(&factor.solve(&y)) - factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        assert!((found - expected).abs() < 1e-6 * expected.abs(), "{found} {expected}");
        // Errors of no size change nothing.
        let (same, zero) = discrepancy.integrated(&total, 0.0);
        assert!(zero == 0.0 && same.vector == total.vector);
    }
}
