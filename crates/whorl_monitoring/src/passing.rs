//! Sensitivities to suspects on their way through the filter, many columns at once.
//!
//! For each start, with S the error of the filter's state per unit of each column, H the readings by state, K the gain,
//! L the lower triangle of the innovations' covariance, T the motion at the end of the bin by state at its start:
//!
//! ```text
//! X = X_own + H S,   S := S - K X,   X := L^-1 X,   z += X^T y,   A += X^T X,   S := T S + S_own
//! ```
//!
//! S has some fifty rows and a hundred columns, H six rows: too small for a general product of matrices, whose copying
//! costs more than its sums. Columns are kept in groups that processors handle at once.

use std::ops::Range;

use nalgebra::DMatrix;
use pulp::Simd;

use crate::filter::Whitened;

/// Columns in a group.
pub(crate) const LANES: usize = 8;
/// One row of a group.
type Lanes = [f64; LANES];

/// What was carried through the filter since one start.
#[derive(Debug, Clone)]
pub(crate) struct Carried {
    /// Rows of the filter's state.
    length: usize,
    /// Error of the filter's state per unit of each column: of each group every row.
    state: Vec<Lanes>,
    /// X^T y of each column, by groups.
    score: Vec<Lanes>,
    /// Sum of |X| of each column, by groups.
    absolute: Vec<Lanes>,
    /// X^T X of each pair of columns that is asked for.
    products: Vec<f64>,
}

/// A bin as every start needs it: what its columns change by themselves, and the filter's matrices by state.
#[derive(Debug, Clone, Default)]
pub(crate) struct Columns {
    groups: usize,
    motion: usize,
    readings: usize,
    /// Rows for which there is room: readings or motion, and zeros.
    room: usize,
    /// X_own and S_own: of each group every row.
    own: Vec<Lanes>,
    at_end: Vec<Lanes>,
    /// H, K and T: of each state one number for each reading (or motion), then zeros.
    by_state: Vec<f64>,
    gain: Vec<f64>,
    transition: Vec<f64>,
    /// L, row by row, and y.
    lower: Vec<f64>,
    innovation: Vec<f64>,
}

/// What is left after the bin of states that forget themselves.
pub(crate) struct Left {
    pub torque: (Range<usize>, f64),
    pub constants: (Range<usize>, f64),
}

impl Carried {
    pub fn new(length: usize, columns: usize, products: usize) -> Self {
        let groups = columns.div_ceil(LANES);
        Self {
            length,
            state: vec![[0.0; LANES]; groups * length],
            score: vec![[0.0; LANES]; groups],
            absolute: vec![[0.0; LANES]; groups],
            products: vec![0.0; products],
        }
    }

    #[cfg(test)]
    pub fn with_sums(score: &[f64], products: &[f64]) -> Self {
        let mut sums = Self::new(0, score.len(), 0);
        for (k, x) in score.iter().enumerate() {
            sums.score[k / LANES][k % LANES] = *x;
        }
        sums.products = products.to_vec();
        sums
    }

    #[cfg(test)]
    pub fn with_absolute(mut self, absolute: &[f64]) -> Self {
        for (k, x) in absolute.iter().enumerate() {
            self.absolute[k / LANES][k % LANES] = *x;
        }
        self
    }

    /// z of a column.
    #[inline]
    pub fn score(&self, column: usize) -> f64 {
        self.score.get(column / LANES).map_or(0.0, |lanes| lanes[column % LANES])
    }

    /// Sum of |X| of a column.
    #[inline]
    pub fn absolute(&self, column: usize) -> f64 {
        self.absolute.get(column / LANES).map_or(0.0, |lanes| lanes[column % LANES])
    }

    /// A of a pair of columns.
    #[inline]
    pub fn product(&self, place: usize) -> f64 {
        self.products.get(place).copied().unwrap_or(0.0)
    }

    /// The first `rows` of the state are unknown.
    pub fn forget(&mut self, rows: usize) {
        for group in self.state.chunks_exact_mut(self.length.max(1)) {
            group.iter_mut().take(rows).for_each(|row| *row = [0.0; LANES]);
        }
    }
}

impl Columns {
    /// Takes a bin: `rate` gives the acceleration of each of `motion` by column, `reading` what a column changes of a
    /// reading directly.
    pub fn load(
        &mut self,
        whitened: &Whitened,
        motion: usize,
        columns: usize,
        rate: impl Fn(usize, usize) -> f64,
        reading: impl Fn(usize, usize) -> f64,
    ) {
        self.groups = columns.div_ceil(LANES);
        (self.motion, self.readings) = (motion, whitened.reading.len());
        self.room = room(motion.max(self.readings));
        let (at_end, half_way) = (&whitened.by_rate.0, &whitened.by_rate.1);
        self.own.clear();
        self.at_end.clear();
        let mut rates = vec![[0.0; LANES]; motion];
        for first in (0..self.groups).map(|group| group * LANES) {
            for (row, lanes) in rates.iter_mut().enumerate() {
                *lanes = std::array::from_fn(|lane| rate(row, first + lane));
            }
            for k in &whitened.reading {
                let mut sum: Lanes = std::array::from_fn(|lane| reading(*k, first + lane));
                for (m, rate) in rates.iter().enumerate() {
                    add_scaled(&mut sum, half_way[(*k, m)], rate);
                }
                self.own.push(sum);
            }
            for row in 0..motion {
                let mut sum = [0.0; LANES];
                for (m, rate) in rates.iter().enumerate() {
                    add_scaled(&mut sum, at_end[(row, m)], rate);
                }
                self.at_end.push(sum);
            }
        }
        // nalgebra stores column by column.
        let room = self.room;
        let keep = |to: &mut Vec<f64>, from: &DMatrix<f64>| {
            to.clear();
            for column in from.as_slice().chunks_exact(from.nrows().max(1)) {
                to.extend(column.iter().copied().chain(std::iter::repeat(0.0)).take(room));
            }
        };
        keep(&mut self.by_state, &whitened.by_state);
        keep(&mut self.gain, &whitened.gain.transpose());
        keep(&mut self.transition, &whitened.transition);
        keep(&mut self.lower, &whitened.lower().transpose());
        self.innovation.clear();
        self.innovation.extend_from_slice(whitened.innovation.as_slice());
    }
}

/// Carries every start through a bin; `products` are the pairs of columns of which products are summed.
pub(crate) fn pass<'a>(
    starts: impl Iterator<Item = &'a mut Carried>,
    columns: &Columns,
    left: &Left,
    products: &[(usize, usize)],
) {
    // Compiled for each kind of processor that pulp knows.
    let processor = pulp::Arch::new();
    let mut whitened = vec![0.0; columns.groups * LANES * columns.readings];
    for carried in starts {
        let bin = (columns, left, products);
        let whitened = whitened.as_mut_slice();
        // Readings of gyro and wheels: sizes of usual platforms, so that sums stay in registers.
        match columns.room {
            3 => processor.dispatch(Pass::<3> { carried, bin, whitened }),
            6 => processor.dispatch(Pass::<6> { carried, bin, whitened }),
            7 => processor.dispatch(Pass::<7> { carried, bin, whitened }),
            _ => processor.dispatch(Pass::<MOST> { carried, bin, whitened }),
        }
    }
}

/// Gyro axes and wheels at most.
const MOST: usize = 3 + whorl_dynamics::gyrostat::MAX_WHEELS;

/// The smallest of the sizes for which code is compiled.
fn room(rows: usize) -> usize {
    [3, 6, 7].into_iter().find(|room| rows <= *room).unwrap_or(MOST)
}

/// One start on its way through a bin, with room for `R` readings.
struct Pass<'a, const R: usize> {
    carried: &'a mut Carried,
    bin: (&'a Columns, &'a Left, &'a [(usize, usize)]),
    /// Whitened readings by column.
    whitened: &'a mut [f64],
}

impl<const R: usize> pulp::WithSimd for Pass<'_, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { carried, bin: (columns, left, products), whitened } = self;
        let length = carried.length;
        for group in 0..columns.groups {
            let Some(state) = carried.state.get_mut(group * length..(group + 1) * length) else { return };
            let x = pass_group::<S, R>(simd, state, columns, group, left);
            if let Some(score) = carried.score.get_mut(group) {
                for (x, y) in x.iter().zip(&columns.innovation) {
                    add_scaled(score, *y, x);
                }
            }
            if let Some(absolute) = carried.absolute.get_mut(group) {
                for x in x.iter().take(columns.readings) {
                    absolute.iter_mut().zip(x).for_each(|(sum, x)| *sum += x.abs());
                }
            }
            for (row, x) in x.iter().enumerate().take(columns.readings) {
                for (lane, x) in x.iter().enumerate() {
                    if let Some(slot) = whitened.get_mut((group * LANES + lane) * columns.readings + row) {
                        *slot = *x;
                    }
                }
            }
        }
        let column = |k: usize| whitened.get(k * columns.readings..(k + 1) * columns.readings).unwrap_or(&[]);
        for (sum, (a, b)) in carried.products.iter_mut().zip(products) {
            *sum += column(*a).iter().zip(column(*b)).map(|(a, b)| a * b).sum::<f64>();
        }
    }
}

/// Carries one group through a bin; its whitened readings.
#[inline(always)]
fn pass_group<S: Simd, const R: usize>(
    simd: S,
    state: &mut [Lanes],
    columns: &Columns,
    group: usize,
    left: &Left,
) -> [Lanes; R] {
    let (readings, motion) = (columns.readings.min(R), columns.motion.min(R));
    let mut x = [[0.0; LANES]; R];
    let own = columns.own.iter().skip(group * columns.readings);
    x.iter_mut().zip(own.take(readings)).for_each(|(x, own)| *x = *own);
    let mut moved = [[0.0; LANES]; R];
    let at_end = columns.at_end.iter().skip(group * columns.motion);
    moved.iter_mut().zip(at_end.take(motion)).for_each(|(moved, at_end)| *moved = *at_end);

    // As many lanes at a time as the processor has.
    let per_row = LANES / S::F64_LANES;
    let (rows, _) = S::as_mut_simd_f64s(state.as_flattened_mut());
    let (all_x, _) = S::as_mut_simd_f64s(x.as_flattened_mut());
    let (all_moved, _) = S::as_mut_simd_f64s(moved.as_flattened_mut());
    for part in 0..per_row {
        let mut x = [simd.splat_f64s(0.0); R];
        x.iter_mut().zip(all_x.iter().skip(part).step_by(per_row)).for_each(|(x, own)| *x = *own);
        let by_state = columns.by_state.as_chunks::<R>().0;
        for (s, h) in rows.iter().skip(part).step_by(per_row).zip(by_state) {
            for (x, h) in x.iter_mut().zip(h) {
                *x = simd.mul_add_e_f64s(simd.splat_f64s(*h), *s, *x);
            }
        }
        let mut moved = [simd.splat_f64s(0.0); R];
        let starts = all_moved.iter().skip(part).step_by(per_row);
        moved.iter_mut().zip(starts).for_each(|(moved, at_end)| *moved = *at_end);
        let by_state = columns.gain.as_chunks::<R>().0.iter().zip(columns.transition.as_chunks::<R>().0);
        for (s, (gain, transition)) in rows.iter_mut().skip(part).step_by(per_row).zip(by_state) {
            let mut left = *s;
            for (x, gain) in x.iter().zip(gain) {
                left = simd.mul_add_e_f64s(simd.splat_f64s(-gain), *x, left);
            }
            *s = left;
            for (moved, transition) in moved.iter_mut().zip(transition) {
                *moved = simd.mul_add_e_f64s(simd.splat_f64s(*transition), left, *moved);
            }
        }
        all_x.iter_mut().skip(part).step_by(per_row).zip(&x).for_each(|(to, x)| *to = *x);
        all_moved.iter_mut().skip(part).step_by(per_row).zip(&moved).for_each(|(to, x)| *to = *x);
    }
    for (range, share) in [&left.torque, &left.constants] {
        for s in state.get_mut(range.clone()).unwrap_or(&mut []) {
            s.iter_mut().for_each(|lane| *lane *= share);
        }
    }
    state.iter_mut().zip(moved.iter().take(motion)).for_each(|(s, moved)| *s = *moved);
    // Forward substitution.
    for row in 0..readings {
        let lower = columns.lower.get(row * R..row * R + readings).unwrap_or(&[]);
        let mut sum = x[row];
        for (x, lower) in x.iter().zip(lower).take(row) {
            add_scaled(&mut sum, -lower, x);
        }
        let pivot = lower.get(row).copied().unwrap_or(1.0);
        x[row] = sum.map(|lane| lane / pivot);
    }
    x
}

/// `a + x b` lane by lane.
#[inline(always)]
fn add_scaled(a: &mut Lanes, x: f64, b: &Lanes) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += x * b;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;

    /// Against the same in general matrices, for platforms with no, three and eight wheels, readings missing too.
    #[test]
    fn groups_carry_what_matrices_say() {
        for (motion, constants, columns) in [(3, 4, 5), (6, 9, 20), (6, 9, 16), (7, 5, 9), (11, 3, 30)] {
            for missing in [0, 1] {
                let readings = motion - missing;
                let (torque, length) = (motion + 3, motion + 6 + constants);
                let numbers = |rows: usize, columns: usize, seed: f64| {
                    DMatrix::from_fn(rows, columns, |i, j| 0.3 * (seed + (i * columns + j) as f64).sin())
                };
                let noise = numbers(readings, readings, 0.3);
                let covariance = &noise * noise.transpose() + DMatrix::identity(readings, readings);
                let whitened = Whitened::of_parts(
                    DVector::from_fn(readings, |i, _| (i as f64).cos()),
                    (missing..motion).collect(),
                    numbers(readings, length, 1.0),
                    covariance.cholesky().unwrap().l(),
                    numbers(length, readings, 2.0),
                    numbers(motion, length, 3.0),
                    (numbers(motion, motion, 4.0), numbers(motion, motion, 5.0)),
                );
                let rates = numbers(motion, columns, 6.0);
                let direct = numbers(motion, columns, 7.0);
                let products: Vec<(usize, usize)> =
                    (1..columns).map(|k| (k - 1, k)).chain([(2, 2)]).collect();
                let left = Left { torque: (torque..torque + 3, 0.9), constants: (torque + 3..length, 0.8) };

                let mut carried = [Carried::new(length, columns, products.len())];
                let mut state = DMatrix::zeros(length, columns);
                let (mut score, mut product) = (DVector::zeros(columns), vec![0.0; products.len()]);
                for _ in 0..3 {
                    let mut bin = Columns::default();
                    let at = |m: &DMatrix<f64>, i: usize, j: usize| if j < columns { m[(i, j)] } else { 0.0 };
                    bin.load(&whitened, motion, columns, |i, j| at(&rates, i, j), |i, j| at(&direct, i, j));
                    pass(carried.iter_mut(), &bin, &left, &products);

                    let own = &whitened.by_rate.1 * &rates + &direct;
                    let own = DMatrix::from_fn(readings, columns, |i, j| own[(whitened.reading[i], j)]);
                    let mut x = own + &whitened.by_state * &state;
                    state -= &whitened.gain * &x;
                    whitened.lower().solve_lower_triangular_mut(&mut x);
                    score += x.transpose() * &whitened.innovation;
                    for (sum, (a, b)) in product.iter_mut().zip(&products) {
                        *sum += x.column(*a).dot(&x.column(*b));
                    }
                    let moved = &whitened.transition * &state + &whitened.by_rate.0 * &rates;
                    state.rows_mut(0, motion).copy_from(&moved);
                    state.rows_mut(torque, 3).scale_mut(0.9);
                    state.rows_mut(torque + 3, length - torque - 3).scale_mut(0.8);
                }
                for k in 0..columns {
                    assert!((carried[0].score(k) - score[k]).abs() < 1e-12 * score.amax().max(1.0));
                }
                let largest = product.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
                for (k, expected) in product.iter().enumerate() {
                    assert!((carried[0].product(k) - expected).abs() < 1e-12 * largest);
                }
            }
        }
    }
}
