//! A run linearised along its motion.

use std::sync::Arc;

use super::System;
use super::hidden::HiddenStates;
use super::measurement::Row;

/// Measurements of a run, in order of time.
#[derive(Debug, Clone, Default)]
struct Measured {
    /// Rows of node k: `first_row[k]..first_row[k + 1]`.
    first_row: Vec<usize>,
    rows: Vec<Row>,
}

/// A run linearised along its motion: what does not depend on the noise.
#[derive(Debug, Clone, Default)]
pub(crate) struct Linear {
    /// Number of states.
    pub n: usize,
    /// What is measured, whatever the noise and the states beside those of the motion are.
    measured: Arc<Measured>,
    /// Of each interval's transition what is in the pattern, row by row.
    transition: Vec<f64>,
    /// Of each row of the transitions, the columns that are not zero all along.
    pattern: Vec<Vec<usize>>,
    /// What the model adds over each interval, intervals x n.
    pub(super) defect: Vec<f64>,
}

impl Linear {
    /// The measurements.
    pub fn rows(&self) -> &[Row] {
        &self.measured.rows
    }

    /// Bytes that it holds, its measurements apart.
    pub fn own_bytes(&self) -> usize {
        size_of::<f64>() * (self.transition.len() + self.defect.len())
    }

    /// Rows of node `k`, by index.
    pub fn rows_of(&self, k: usize) -> std::ops::Range<usize> {
        match (self.measured.first_row.get(k), self.measured.first_row.get(k + 1)) {
            (Some(first), Some(end)) => *first..*end,
            _ => 0..0,
        }
    }

    /// Rows of the transition over interval `k`: columns that are not zero, and what stands there.
    #[inline]
    pub fn transition_over(&self, k: usize) -> impl Iterator<Item = (&[usize], &[f64])> {
        let size: usize = self.pattern.iter().map(Vec::len).sum();
        let mut rest = self.transition.get(k * size..(k + 1) * size).unwrap_or(&[]);
        self.pattern.iter().map(move |columns| {
            let (row, after) = rest.split_at_checked(columns.len()).unwrap_or_default();
            rest = after;
            (columns.as_slice(), row)
        })
    }

    /// The transition over interval `k` in full, n x n.
    pub(super) fn dense_transition(&self, k: usize, f: &mut [f64]) {
        f.fill(0.0);
        for (slots, (columns, row)) in f.chunks_exact_mut(self.n.max(1)).zip(self.transition_over(k)) {
            for (column, x) in columns.iter().zip(row) {
                slots[*column] = *x;
            }
        }
    }
}

/// Transitions as they come, of which only what is not zero in some of them is kept: half to nine tenths of a full matrix
/// are zero all along, and there are tens of thousands of them.
struct Transitions {
    n: usize,
    intervals: usize,
    /// Positions in a full matrix that are kept, in order.
    used: Vec<usize>,
    is_used: Vec<bool>,
    values: Vec<f64>,
}

impl Transitions {
    fn new(n: usize, intervals: usize) -> Self {
        Self { n, intervals, used: Vec::new(), is_used: vec![false; n * n], values: Vec::new() }
    }

    /// Adds a transition, n x n.
    fn push(&mut self, f: &[f64]) {
        if f.iter().zip(&self.is_used).any(|(x, used)| *x != 0.0 && !used) {
            self.widen(f);
        }
        self.values.extend(self.used.iter().map(|i| f[*i]));
    }

    /// Also keeps what is not zero in `f`: it was zero before. That happens in the first interval, and a few times later.
    fn widen(&mut self, f: &[f64]) {
        let before = std::mem::take(&mut self.used);
        self.is_used.iter_mut().zip(f).for_each(|(used, x)| *used |= *x != 0.0);
        self.used = (0..self.is_used.len()).filter(|i| self.is_used[*i]).collect();
        let mut values = Vec::with_capacity(self.intervals * self.used.len());
        for kept in self.values.chunks_exact(before.len().max(1)) {
            let mut kept = before.iter().zip(kept).peekable();
            let value = |i: &usize| kept.next_if(|(own, _)| *own == i).map_or(0.0, |(_, x)| *x);
            values.extend(self.used.iter().map(value));
        }
        self.values = values;
    }

    /// Of each row the columns that are kept, and the values.
    fn finish(self) -> (Vec<Vec<usize>>, Vec<f64>) {
        let n = self.n;
        let of_row = |row: usize| (0..n).filter(|column| self.is_used[row * n + column]).collect();
        ((0..n).map(of_row).collect(), self.values)
    }
}

impl System<'_> {
    /// Linearises the run; systems that differ by the intensity of their noise share the result.
    pub fn linear(&self) -> Linear {
        let mut measured = Measured::default();
        for k in 0..self.run.nodes() {
            measured.first_row.push(measured.rows.len());
            self.rows(k, &mut measured.rows);
        }
        measured.first_row.push(measured.rows.len());
        self.linear_of(Arc::new(measured))
    }

    /// As [`Self::linear`], where `alike` is that of a system of the same run, motion and prediction.
    pub fn linear_as(&self, alike: &Linear) -> Linear {
        self.linear_of(Arc::clone(&alike.measured))
    }

    fn linear_of(&self, measured: Arc<Measured>) -> Linear {
        let n = self.states();
        let intervals = self.run.nodes().saturating_sub(1);
        let mut linear = Linear { n, measured, defect: vec![0.0; intervals * n], ..Linear::default() };
        let mut transitions = Transitions::new(n, intervals);
        let (mut a, mut f) = (vec![0.0; n * n], vec![0.0; n * n]);
        let mut hidden = HiddenStates::default();
        for (k, d) in linear.defect.chunks_exact_mut(n).enumerate() {
            self.transition(k, &mut a, &mut f);
            self.hidden_transition(k, &mut hidden, &mut f);
            self.defect(k, d);
            transitions.push(&f);
        }
        (linear.pattern, linear.transition) = transitions.finish();
        linear
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_becomes_nonzero_late_was_zero_before() {
        let transitions = [[1.0, 0.0, 0.0, 2.0], [3.0, 0.0, 0.0, 0.0], [4.0, 0.0, 5.0, 6.0]];
        let mut kept = Transitions::new(2, 3);
        transitions.iter().for_each(|f| kept.push(f));
        let (pattern, transition) = kept.finish();
        let linear = Linear { n: 2, pattern, transition, ..Linear::default() };
        assert_eq!(linear.pattern, [vec![0], vec![0, 1]]);
        let mut dense = [0.0; 4];
        for (k, f) in transitions.iter().enumerate() {
            linear.dense_transition(k, &mut dense);
            assert_eq!(dense, *f);
        }
    }
}
