//! Rows of sparse matrices, kept with seven digits.

use super::{MOST_STATES, Sparse};

// A column fits into a byte.
const _: () = assert!(MOST_STATES <= 256);

/// Many rows, one below the other.
#[derive(Debug, Clone, Default)]
pub struct Packed {
    /// Behind the last entry of each row.
    ends: Vec<u32>,
    columns: Vec<u8>,
    values: Vec<f32>,
}

impl Packed {
    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.ends.clear();
        self.columns.clear();
        self.values.clear();
    }

    /// Appends all rows of a matrix.
    pub fn append(&mut self, matrix: &Sparse) {
        for row in matrix.rows() {
            self.columns.extend(row.iter().map(|(k, _)| *k as u8));
            self.values.extend(row.iter().map(|(_, x)| *x as f32));
            self.ends.push(self.values.len() as u32);
        }
    }

    /// Writes only these rows over a matrix.
    pub fn rows_to(&self, rows: std::ops::Range<usize>, to: &mut Sparse) {
        to.clear();
        for i in rows {
            let begin = if i == 0 { 0 } else { self.ends[i - 1] as usize };
            let entries = begin..self.ends[i] as usize;
            for (k, x) in self.columns[entries.clone()].iter().zip(&self.values[entries]) {
                to.set(usize::from(*k), f64::from(*x));
            }
            to.end_row();
        }
    }

    /// How many rows there are.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// Memory that it fills.
    pub fn bytes(&self) -> usize {
        4 * self.ends.len() + 5 * self.values.len()
    }
}
