//! Rows of numbers side by side, and what a filter does to them: no allocation, fixed widths, the processor's own instructions.
//!
//! A covariance, the sensitivities of an estimate and the way of an error are all rows by coordinate of the state, on which a step and a
//! reading act in the same way:
//!
//! ```text
//! step:     X <- F X                          F sparse
//! readings: d_r = D_r - h_r X - sum_{q<r} L_rq d_q,  L_rq = h_r k_q        X <- X + sum_r k_r d_r
//! ```
//!
//! with the derivatives h_r of the readings of one instant, one after the other, and their gains k_r.

#![expect(clippy::needless_range_loop, reason = "rows and columns of the same matrix go by their index")]

use nalgebra::{DMatrix, Vector3};
use pulp::NullaryFnOnce;

/// Widths of rows: multiples of what processors handle at once. Columns of parameters go by blocks of [`BLOCK`].
const WIDTHS: [usize; 4] = [16, 24, 32, 64];
/// Columns of parameters that are carried together.
pub(crate) const BLOCK: usize = 32;
/// Coordinates of a state at most: six of the body, sixteen hidden, eight wheels with their motors, nine of random torques, six biases.
pub(crate) const MOST_STATES: usize = 64;

/// A matrix by rows, of which only some entries are not zero.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Sparse {
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
pub(crate) fn dot(row: &[(usize, f64)], state: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (i, x) in row {
        sum += x * state[*i];
    }
    sum
}

/// How the readings of an instant change the state, one after the other.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gain {
    size: usize,
    /// Of each reading, coordinate by coordinate.
    gains: Vec<f64>,
    /// L, row by row below the diagonal.
    couplings: Vec<f64>,
    /// Variances of the innovations.
    pub variances: Vec<f64>,
}

impl Gain {
    /// No readings yet, of a state of this size.
    pub fn clear(&mut self, size: usize) {
        self.size = size;
        self.gains.clear();
        self.couplings.clear();
        self.variances.clear();
    }

    /// How many readings there are.
    pub fn count(&self) -> usize {
        self.variances.len()
    }

    /// The gain of a reading.
    #[inline(always)]
    pub fn of(&self, reading: usize) -> &[f64] {
        &self.gains[reading * self.size..(reading + 1) * self.size]
    }

    /// How a reading's prediction has been changed by those before it, per their innovations.
    #[inline(always)]
    pub fn couplings(&self, reading: usize) -> &[f64] {
        let first = first_coupling(reading);
        &self.couplings[first..first + reading]
    }
}

/// Where the couplings of a reading begin.
#[inline(always)]
fn first_coupling(reading: usize) -> usize {
    reading * reading.saturating_sub(1) / 2
}

impl Gain {
    /// Appends what it has to lists: gains, couplings, variances.
    pub fn append_to(&self, gains: &mut Vec<f32>, couplings: &mut Vec<f32>, variances: &mut Vec<f64>) {
        gains.extend(self.gains.iter().map(|x| *x as f32));
        couplings.extend(self.couplings.iter().map(|x| *x as f32));
        variances.extend(&self.variances);
    }

    /// Takes that of so many readings back from lists, of gains and couplings, and of variances, each from a place on which it moves on.
    pub fn take_from(
        &mut self,
        size: usize,
        count: usize,
        [gains, couplings]: [&[f32]; 2],
        variances: &[f64],
        at: &mut [usize; 3],
    ) {
        let lengths = [count * size, count * count.saturating_sub(1) / 2, count];
        let [of_gains, of_couplings, of_variances] = [0, 1, 2].map(|k| at[k]..at[k] + lengths[k]);
        self.clear(size);
        self.gains.extend(gains[of_gains].iter().map(|x| f64::from(*x)));
        self.couplings.extend(couplings[of_couplings].iter().map(|x| f64::from(*x)));
        self.variances.extend(&variances[of_variances]);
        at.iter_mut().zip(lengths).for_each(|(at, length)| *at += length);
    }
}

/// Rows side by side.
#[derive(Debug, Clone)]
pub(crate) struct Lanes {
    width: usize,
    data: Vec<f64>,
    spare: Vec<f64>,
}

/// Runs a kernel that has the width as a constant, compiled for each kind of processor. A kernel is a value and no closure: what calls a
/// closure is compiled for the least of all processors.
macro_rules! wide {
    ($width:expr, $kernel:ident { $($field:ident: $value:expr),* }) => {{
        let processor = pulp::Arch::new();
        match $width {
            16 => processor.dispatch($kernel::<16> { $($field: $value),* }),
            24 => processor.dispatch($kernel::<24> { $($field: $value),* }),
            32 => processor.dispatch($kernel::<32> { $($field: $value),* }),
            _ => processor.dispatch($kernel::<64> { $($field: $value),* }),
        }
    }};
}

impl Lanes {
    /// Zeros, with room for at least so many numbers in a row, at most [`MOST_STATES`].
    pub fn zeros(rows: usize, least: usize) -> Self {
        let width = WIDTHS.into_iter().find(|width| least <= *width).unwrap_or(MOST_STATES);
        Self { width, data: vec![0.0; rows * width], spare: Vec::new() }
    }

    /// A unit matrix.
    pub fn identity(size: usize, least: usize) -> Self {
        let mut lanes = Self::zeros(size, least);
        (0..size).for_each(|i| lanes.row_mut(i)[i] = 1.0);
        lanes
    }

    /// A matrix.
    pub fn of(matrix: &DMatrix<f64>) -> Self {
        let mut lanes = Self::zeros(matrix.nrows(), matrix.ncols());
        for i in 0..matrix.nrows() {
            for k in 0..matrix.ncols() {
                lanes.data[i * lanes.width + k] = matrix[(i, k)];
            }
        }
        lanes
    }

    /// How many numbers are in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// How many rows there are.
    pub fn rows(&self) -> usize {
        self.data.len() / self.width
    }

    /// A row.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.width..(i + 1) * self.width]
    }

    /// See [`Self::row`].
    #[inline(always)]
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.data[i * self.width..(i + 1) * self.width]
    }

    /// So many rows of zeros.
    pub fn clear(&mut self, rows: usize) {
        self.data.clear();
        self.data.resize(rows * self.width, 0.0);
    }

    /// The first rows and columns.
    pub fn matrix(&self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |i, k| self.data[i * self.width + k])
    }

    /// X <- F X of the first rows, F one more than this.
    pub fn carry(&mut self, transition: &Sparse) {
        let Self { width, data, spare } = self;
        spare.resize(data.len(), 0.0);
        wide!(*width, Carry { data: data, spare: spare, transition: transition });
    }

    /// Rows of an attitude without what is about an axis.
    pub fn level(&mut self, axis: &Vector3<f64>) {
        for k in 0..self.width {
            let [x, y, z] = [0, 1, 2].map(|i| self.data[i * self.width + k]);
            let about = axis.x * x + axis.y * y + axis.z * z;
            for i in 0..3 {
                self.data[i * self.width + k] -= about * axis[i];
            }
        }
    }

    /// P <- F P F^T + Q of a covariance, Q with rows of this width.
    pub fn grow(&mut self, transition: &Sparse, noise: Option<&Self>) {
        let Self { width, data, spare } = self;
        spare.resize(2 * data.len(), 0.0);
        let noise = noise.map_or(&[][..], |noise| &noise.data);
        wide!(*width, Grow { data: data, spare: spare, transition: transition, noise: noise });
    }

    /// A covariance without turns about an axis.
    pub fn level_covariance(&mut self, axis: &Vector3<f64>) {
        self.level(axis);
        for row in self.data.chunks_exact_mut(self.width) {
            let about = axis.x * row[0] + axis.y * row[1] + axis.z * row[2];
            (0..3).for_each(|i| row[i] -= about * axis[i]);
        }
    }

    /// Takes readings with these derivatives, a row each, and variances of their own out of a covariance; false where it is none any
    /// more.
    pub fn correct(&mut self, readings: &Sparse, own: &[f64], gain: &mut Gain) -> bool {
        let Self { width, data, spare } = self;
        spare.clear();
        spare.resize(readings.count() * *width, 0.0);
        gain.clear(data.len() / *width);
        wide!(*width, Correct { data: data, spare: spare, readings: readings, own: own, gain: gain })
    }

    /// Takes readings into sensitivities: `d` has how they change where the state does not, and afterwards how their innovations do.
    pub fn take_in(&mut self, readings: &Sparse, gain: &Gain, d: &mut Self) {
        wide!(self.width, TakeIn { data: &mut self.data, readings: readings, gain: gain, d: &mut d.data });
    }

    /// X <- scale A X into another, without a one in A.
    pub fn multiply(&self, a: &Sparse, scale: f64, to: &mut Self) {
        wide!(self.width, Multiply { data: &self.data, a: a, scale: scale, to: &mut to.data });
    }

    /// X + X^T of the first rows and columns, into another.
    pub fn add_transposed(&self, size: usize, to: &mut Self) {
        wide!(self.width, AddTransposed { data: &self.data, size: size, to: &mut to.data });
    }

    /// Adds another of the same shape.
    pub fn add(&mut self, other: &Self) {
        self.data.iter_mut().zip(&other.data).for_each(|(x, y)| *x += y);
    }

    /// What is largest, whatever its sign.
    pub fn largest(&self) -> f64 {
        self.data.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
    }

    /// Nothing is uncertain of a coordinate, or moves it.
    pub fn hold_row(&mut self, i: usize) {
        self.row_mut(i).fill(0.0);
    }

    /// The same of a covariance.
    pub fn hold(&mut self, i: usize) {
        self.hold_row(i);
        self.data.chunks_exact_mut(self.width).for_each(|row| row[i] = 0.0);
    }
}

#[inline(always)]
fn add_scaled<const W: usize>(to: &mut [f64; W], x: f64, of: &[f64; W]) {
    for c in 0..W {
        to[c] += x * of[c];
    }
}

/// Adds a row's product with other rows.
#[inline(always)]
fn add_rows<const W: usize>(to: &mut [f64; W], row: &[(usize, f64)], of: &[[f64; W]]) {
    for (k, x) in row {
        add_scaled(to, *x, &of[*k]);
    }
}

/// See [`Lanes::carry`].
struct Carry<'a, const W: usize> {
    data: &'a mut [f64],
    spare: &'a mut [f64],
    transition: &'a Sparse,
}

impl<const W: usize> NullaryFnOnce for Carry<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, behind) = (self.data.as_chunks_mut::<W>().0, self.spare.as_chunks_mut::<W>().0);
        let moving = self.transition.count();
        for i in 0..moving {
            let mut sum = x[i];
            add_rows(&mut sum, self.transition.row(i), x);
            behind[i] = sum;
        }
        x[..moving].copy_from_slice(&behind[..moving]);
    }
}

/// See [`Lanes::multiply`].
struct Multiply<'a, const W: usize> {
    data: &'a [f64],
    a: &'a Sparse,
    scale: f64,
    to: &'a mut [f64],
}

impl<const W: usize> NullaryFnOnce for Multiply<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, to) = (self.data.as_chunks::<W>().0, self.to.as_chunks_mut::<W>().0);
        for i in 0..self.a.count() {
            let mut sum = [0.0; W];
            for (k, f) in self.a.row(i) {
                add_scaled(&mut sum, self.scale * f, &x[*k]);
            }
            to[i] = sum;
        }
    }
}

/// See [`Lanes::add_transposed`].
struct AddTransposed<'a, const W: usize> {
    data: &'a [f64],
    size: usize,
    to: &'a mut [f64],
}

impl<const W: usize> NullaryFnOnce for AddTransposed<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, to) = (self.data.as_chunks::<W>().0, self.to.as_chunks_mut::<W>().0);
        for i in 0..self.size {
            for k in 0..=i {
                let both = x[i][k] + x[k][i];
                (to[i][k], to[k][i]) = (both, both);
            }
        }
    }
}

/// See [`Lanes::grow`].
struct Grow<'a, const W: usize> {
    data: &'a mut [f64],
    spare: &'a mut [f64],
    transition: &'a Sparse,
    noise: &'a [f64],
}

impl<const W: usize> NullaryFnOnce for Grow<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (p, noise) = (self.data.as_chunks_mut::<W>().0, self.noise.as_chunks::<W>().0);
        let (behind, across) = self.spare.as_chunks_mut::<W>().0.split_at_mut(p.len());
        let (transition, moving) = (self.transition, self.transition.count());
        // F P, of what moves; what stays beside it is then as it should be.
        for i in 0..moving {
            let mut sum = p[i];
            add_rows(&mut sum, transition.row(i), p);
            behind[i] = sum;
        }
        for i in 0..moving {
            for k in 0..moving {
                across[k][i] = behind[i][k];
            }
        }
        // F (F P)^T.
        for i in 0..moving {
            let mut sum = across[i];
            add_rows(&mut sum, transition.row(i), across);
            p[i][..moving].copy_from_slice(&sum[..moving]);
            p[i][moving..].copy_from_slice(&behind[i][moving..]);
        }
        for i in moving..p.len() {
            for k in 0..moving {
                p[i][k] = p[k][i];
            }
        }
        // Rounding would add up.
        for i in 0..moving {
            for k in 0..i {
                let mean = 0.5 * (p[i][k] + p[k][i]);
                (p[i][k], p[k][i]) = (mean, mean);
            }
        }
        for i in 0..noise.len() {
            add_scaled(&mut p[i], 1.0, &noise[i]);
        }
    }
}

/// See [`Lanes::correct`].
struct Correct<'a, const W: usize> {
    data: &'a mut [f64],
    spare: &'a mut [f64],
    readings: &'a Sparse,
    own: &'a [f64],
    gain: &'a mut Gain,
}

impl<const W: usize> NullaryFnOnce for Correct<'_, W> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        let (p, across) = (self.data.as_chunks_mut::<W>().0, self.spare.as_chunks_mut::<W>().0);
        let (gain, size) = (self.gain, p.len());
        let count = self.readings.count();
        gain.couplings.resize(count * count.saturating_sub(1) / 2, 0.0);
        gain.gains.resize(count * size, 0.0);
        for r in 0..count {
            // P h^T as the readings before have left P.
            let (by_state, mut a) = (self.readings.row(r), [0.0; W]);
            add_rows(&mut a, by_state, p);
            for q in 0..r {
                let coupling = dot(by_state, gain.of(q));
                gain.couplings[first_coupling(r) + q] = coupling;
                if coupling != 0.0 {
                    add_scaled(&mut a, -coupling, &across[q]);
                }
            }
            let variance = dot(by_state, &a) + self.own[r];
            if !(variance > 0.0 && variance.is_finite()) {
                return false;
            }
            let inverse = 1.0 / variance;
            for (gain, a) in gain.gains[r * size..(r + 1) * size].iter_mut().zip(&a) {
                *gain = a * inverse;
            }
            gain.variances.push(variance);
            across[r] = a;
        }
        for i in 0..size {
            let mut sum = p[i];
            for r in 0..count {
                add_scaled(&mut sum, -gain.gains[r * size + i], &across[r]);
            }
            p[i] = sum;
        }
        true
    }
}

/// See [`Lanes::take_in`].
struct TakeIn<'a, const W: usize> {
    data: &'a mut [f64],
    readings: &'a Sparse,
    gain: &'a Gain,
    d: &'a mut [f64],
}

impl<const W: usize> NullaryFnOnce for TakeIn<'_, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (x, d) = (self.data.as_chunks_mut::<W>().0, self.d.as_chunks_mut::<W>().0);
        let count = self.readings.count();
        for r in 0..count {
            let mut sum = d[r];
            for (i, h) in self.readings.row(r) {
                add_scaled(&mut sum, -h, &x[*i]);
            }
            let couplings = self.gain.couplings(r);
            for q in 0..r {
                if couplings[q] != 0.0 {
                    add_scaled(&mut sum, -couplings[q], &d[q]);
                }
            }
            d[r] = sum;
        }
        let (size, gains) = (self.gain.size, &self.gain.gains);
        for i in 0..size {
            let mut sum = x[i];
            for r in 0..count {
                add_scaled(&mut sum, gains[r * size + i], &d[r]);
            }
            x[i] = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some(rows: usize, columns: usize, seed: f64) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |i, k| (seed + (i * 7 + k * 3) as f64).sin())
    }

    fn sparse_of(matrix: &DMatrix<f64>) -> Sparse {
        let mut sparse = Sparse::default();
        (0..matrix.nrows()).for_each(|i| sparse.push(matrix.row(i).iter().copied()));
        sparse
    }

    /// Textbook forms, with whole matrices: of what moves only the first coordinates, behind them what stays.
    #[test]
    fn covariances_grow_and_are_corrected_as_whole_matrices_say() {
        for size in [5, 18, 24, 31, 50] {
            let moving = size - 2;
            let seed = some(size, size, 0.3);
            let mut p = &seed * seed.transpose() + DMatrix::identity(size, size);
            let mut lanes = Lanes::of(&p);
            let off = some(moving, moving, 1.1).map(|x| if x > 0.4 { 0.1 * x } else { 0.0 });
            let mut f = DMatrix::identity(size, size);
            f.view_mut((0, 0), (moving, moving)).copy_from(&(DMatrix::identity(moving, moving) + &off));
            let q = DMatrix::from_diagonal(&nalgebra::DVector::from_fn(size, |i, _| 0.01 * i as f64));
            lanes.grow(&sparse_of(&off), Some(&Lanes::of(&q)));
            p = &f * &p * f.transpose() + &q;
            assert!((lanes.matrix(size, size) - &p).amax() < 1e-12 * p.amax());
            // Readings one after the other are all at once.
            let h = some(3, size, 2.0).map(|x| if x > 0.0 { x } else { 0.0 });
            let r = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![0.5, 1.0, 2.0]));
            let rows = sparse_of(&h);
            let mut gain = Gain::default();
            assert!(lanes.correct(&rows, &[0.5, 1.0, 2.0], &mut gain));
            let s = &h * &p * h.transpose() + r;
            let k = &p * h.transpose() * s.clone().try_inverse().unwrap();
            let expected = (DMatrix::identity(size, size) - &k * &h) * &p;
            assert!((lanes.matrix(size, size) - &expected).amax() < 1e-11 * p.amax());
            let log_det: f64 = gain.variances.iter().map(|s| s.ln()).sum();
            assert!((log_det - s.determinant().ln()).abs() < 1e-11);
            // Sensitivities, with what readings show by themselves.
            let (x, direct) = (some(size, 7, 0.7), some(3, 7, 0.9));
            let mut carried = Lanes::of(&x);
            let mut d = Lanes::of(&direct);
            carried.carry(&sparse_of(&off));
            let moved = &f * &x;
            assert!((carried.matrix(size, 7) - &moved).amax() < 1e-13);
            carried.take_in(&rows, &gain, &mut d);
            let expected = &moved + &k * (&direct - &h * &moved);
            assert!((carried.matrix(size, 7) - expected).amax() < 1e-11);
        }
    }

    #[test]
    fn a_covariance_without_a_turn_has_none_left() {
        let seed = some(6, 6, 0.3);
        let p = &seed * seed.transpose();
        let axis = Vector3::new(0.6, 0.0, 0.8);
        let mut lanes = Lanes::of(&p);
        lanes.level_covariance(&axis);
        let mut project = DMatrix::identity(6, 6);
        let turn = nalgebra::Matrix3::identity() - axis * axis.transpose();
        project.view_mut((0, 0), (3, 3)).copy_from(&turn);
        assert!((lanes.matrix(6, 6) - &project * &p * project.transpose()).amax() < 1e-14);
    }
}
