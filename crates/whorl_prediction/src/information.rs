//! The information that innovations bring, gathered so many at a time: products of large matrices take less time.

use nalgebra::DMatrix;

/// Innovations that are added together.
const TOGETHER: usize = 64;
/// Rows and columns of the blocks in which a sum is made, of which one half is the other's mirror.
const BLOCK: usize = 32;

/// Sum of d d^T / S over innovations of variance S, d how each changes with parameters and laws.
#[derive(Debug, Clone)]
pub(crate) struct Information {
    /// The lower half.
    sum: DMatrix<f64>,
    /// d / sqrt(S) of those that are not in it yet, a column each, and how many these are.
    waiting: DMatrix<f64>,
    count: usize,
    /// First and last but one of every block.
    blocks: Vec<(usize, usize)>,
    /// The first that is a law, and laws so far from each other that nobody asks for their product.
    first_law: usize,
    apart: usize,
}

impl Information {
    /// Of so many parameters, and behind them laws, of which those `apart` take no part together.
    pub fn new(parameters: usize, laws: usize, apart: usize) -> Self {
        let size = parameters + laws;
        let of = |from: usize, to: usize| {
            (from..to).step_by(BLOCK).map(move |first| (first, (first + BLOCK).min(to)))
        };
        Self {
            sum: DMatrix::zeros(size, size),
            waiting: DMatrix::zeros(size, TOGETHER),
            count: 0,
            blocks: of(0, parameters).chain(of(parameters, size)).collect(),
            first_law: parameters,
            apart,
        }
    }

    /// Room for d / sqrt(S) of another innovation, which is in the sum once it is [`Self::added`].
    pub fn next(&mut self) -> &mut [f64] {
        let size = self.sum.nrows();
        &mut self.waiting.as_mut_slice()[self.count * size..(self.count + 1) * size]
    }

    /// The innovation is as it should be.
    pub fn added(&mut self) {
        self.count += 1;
        if self.count == TOGETHER {
            self.gather();
        }
    }

    fn gather(&mut self) {
        let waiting = self.waiting.columns(0, self.count);
        let across = waiting.transpose();
        for (k, &(row, row_end)) in self.blocks.iter().enumerate() {
            for &(column, column_end) in &self.blocks[..=k] {
                if column >= self.first_law && row + 1 > column_end + self.apart {
                    continue;
                }
                let (rows, columns) = (row_end - row, column_end - column);
                let mut block = self.sum.view_mut((row, column), (rows, columns));
                block.gemm(1.0, &waiting.rows(row, rows), &across.columns(column, columns), 1.0);
            }
        }
        self.count = 0;
    }

    /// The sum over all so far.
    pub fn sum(mut self) -> DMatrix<f64> {
        self.gather();
        self.sum.fill_upper_triangle_with_lower_triangle();
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;

    #[test]
    fn sums_all_products_but_those_of_laws_that_are_far_apart() {
        let (parameters, laws, apart) = (40, 75, 3);
        let size = parameters + laws;
        let mut information = Information::new(parameters, laws, apart);
        let mut expected = DMatrix::zeros(size, size);
        for n in 0..150 {
            let d = DVector::from_fn(size, |i, _| f64::sin((i * 7 + n * 13) as f64));
            let variance = 1.0 + (n % 5) as f64;
            information.next().iter_mut().zip(&d).for_each(|(to, d)| *to = d / variance.sqrt());
            information.added();
            expected += &d * d.transpose() / variance;
        }
        let found = information.sum();
        for i in 0..size {
            for j in 0..size {
                if i.min(j) < parameters || i.abs_diff(j) < apart {
                    assert!((found[(i, j)] - expected[(i, j)]).abs() < 1e-10, "{i} {j}");
                }
            }
        }
        assert_eq!(found[(size - 1, parameters)], 0.0);
    }
}
