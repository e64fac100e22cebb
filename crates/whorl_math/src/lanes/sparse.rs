//! Matrices and states of which only some entries are not zero.

/// A matrix by rows, of which only some entries are not zero.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sparse {
    /// Behind the last entry of each row.
    ends: Vec<usize>,
    entries: Vec<(usize, f64)>,
}

impl Sparse {
    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.ends.clear();
        self.entries.clear();
    }

    /// Appends a row; zeros are left out.
    pub fn push(&mut self, row: impl Iterator<Item = f64>) {
        row.enumerate().for_each(|(k, x)| self.set(k, x));
        self.end_row();
    }

    /// Sets an entry of the row that is being appended, once.
    #[inline]
    pub fn set(&mut self, column: usize, x: f64) {
        if x != 0.0 {
            self.entries.push((column, x));
        }
    }

    /// The row that was being appended is whole.
    #[inline]
    pub fn end_row(&mut self) {
        self.ends.push(self.entries.len());
    }

    /// Becomes another's columns as rows, of a square matrix.
    pub fn transpose(&mut self, of: &Self) {
        self.clear();
        self.ends.resize(of.count(), 0);
        // How many entries each row has, then where the next of each goes; behind the last of them it ends.
        of.entries.iter().for_each(|(k, _)| self.ends[*k] += 1);
        let mut begin = 0;
        for end in &mut self.ends {
            let count = *end;
            *end = begin;
            begin += count;
        }
        self.entries.resize(begin, (0, 0.0));
        for (i, k, x) in of.entries() {
            self.entries[self.ends[k]] = (i, x);
            self.ends[k] += 1;
        }
    }

    /// How many rows there are.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// A row: columns, each once, with their values.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[(usize, f64)] {
        let begin = if i == 0 { 0 } else { self.ends[i - 1] };
        &self.entries[begin..self.ends[i]]
    }

    /// All rows.
    #[inline(always)]
    pub fn rows(&self) -> impl Iterator<Item = &[(usize, f64)]> {
        let begins = std::iter::once(&0).chain(&self.ends);
        begins.zip(&self.ends).map(|(begin, end)| &self.entries[*begin..*end])
    }

    /// Row and column of each entry, with its value.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.rows().enumerate().flat_map(|(i, row)| row.iter().map(move |(k, x)| (i, *k, *x)))
    }
}

/// The product of a row with a state.
#[inline(always)]
pub fn dot(row: &[(usize, f64)], state: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (i, x) in row {
        sum += x * state[*i];
    }
    sum
}
