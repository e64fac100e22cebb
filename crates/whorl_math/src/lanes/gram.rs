//! Sums of products of columns, row after row: of innovations the information that they bring. Gathered so many at a time.

use nalgebra::DMatrix;
use pulp::NullaryFnOnce;

/// Innovations that are added together.
const TOGETHER: usize = 64;
/// Rows and columns of the tiles in which a sum is made: as much as a processor's registers hold.
const TILE: [usize; 2] = [4, 8];

/// Sum of d d^T / S over innovations of variance S, d how each changes with parameters and laws.
#[derive(Debug, Clone)]
pub struct Gram {
    count: usize,
    /// The same in whole tiles.
    padded: usize,
    /// The lower half, row by row.
    sum: Vec<f64>,
    /// d / sqrt(S) of those that are not in it yet, a row each, and how many these are.
    waiting: Vec<f64>,
    waits: usize,
    /// The first that is a law, and laws so far from each other that nobody asks for their product.
    first_law: usize,
    apart: usize,
}

impl Gram {
    /// Of so many parameters, and behind them laws, of which those `apart` take no part together.
    pub fn new(parameters: usize, laws: usize, apart: usize) -> Self {
        let count = parameters + laws;
        let padded = count.next_multiple_of(TILE[1]);
        Self {
            count,
            padded,
            sum: vec![0.0; padded * padded],
            waiting: vec![0.0; padded * TOGETHER],
            waits: 0,
            first_law: parameters,
            apart,
        }
    }

    /// Room for d / sqrt(S) of another innovation, which is in the sum once it is [`Self::added`].
    pub fn room(&mut self) -> &mut [f64] {
        let from = self.waits * self.padded;
        &mut self.waiting[from..from + self.count]
    }

    /// The innovation is as it should be.
    pub fn added(&mut self) {
        self.waits += 1;
        if self.waits == TOGETHER {
            self.gather();
        }
    }

    /// What is in the sum of two of them.
    #[inline(always)]
    pub fn product(&self, i: usize, k: usize) -> f64 {
        self.sum[i.max(k) * self.padded + i.min(k)]
    }

    /// Puts all that waits into the sum.
    pub fn gather(&mut self) {
        pulp::Arch::new().dispatch(Gather(self));
    }

    /// The sum over all so far.
    pub fn sum(mut self) -> DMatrix<f64> {
        self.gather();
        DMatrix::from_fn(self.count, self.count, |i, k| self.product(i, k))
    }
}

/// Adds what waits, compiled for each kind of processor.
struct Gather<'a>(&'a mut Gram);

impl NullaryFnOnce for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Gram { padded, sum, waiting, waits, first_law, apart, .. } = self.0;
        let [tall, wide] = TILE;
        for i in 0..*padded / tall {
            for j in 0..=i * tall / wide {
                let (i, j) = (i * tall, j * wide);
                if j >= *first_law && i >= j + wide + *apart {
                    continue;
                }
                let mut tile = [[0.0; TILE[1]]; TILE[0]];
                for n in 0..*waits {
                    let row = &waiting[n * *padded..(n + 1) * *padded];
                    let (down, across) = (&row[i..i + tall], &row[j..j + wide]);
                    for k in 0..TILE[0] {
                        for l in 0..TILE[1] {
                            tile[k][l] += down[k] * across[l];
                        }
                    }
                }
                for k in 0..TILE[0] {
                    let sum = &mut sum[(i + k) * *padded + j..][..TILE[1]];
                    for l in 0..TILE[1] {
                        sum[l] += tile[k][l];
                    }
                }
            }
        }
        *waits = 0;
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
        let mut gram = Gram::new(parameters, laws, apart);
        let mut expected = DMatrix::zeros(size, size);
        for n in 0..150 {
            let d = DVector::from_fn(size, |i, _| f64::sin((i * 7 + n * 13) as f64));
            let variance = 1.0 + (n % 5) as f64;
            gram.room().iter_mut().zip(&d).for_each(|(to, d)| *to = d / variance.sqrt());
            gram.added();
            expected += &d * d.transpose() / variance;
        }
        let found = gram.sum();
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
