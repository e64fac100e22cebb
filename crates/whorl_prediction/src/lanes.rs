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
    row.iter().map(|(i, x)| x * state[*i]).sum()
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
        let first = reading * reading.saturating_sub(1) / 2;
        &self.couplings[first..first + reading]
    }
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

/// Calls a function that has the width as a constant, compiled for each kind of processor.
macro_rules! wide {
    ($width:expr, $function:ident($($argument:expr),*)) => {{
        let processor = pulp::Arch::new();
        match $width {
            16 => processor.dispatch(#[inline(always)] || $function::<16>($($argument),*)),
            24 => processor.dispatch(#[inline(always)] || $function::<24>($($argument),*)),
            32 => processor.dispatch(#[inline(always)] || $function::<32>($($argument),*)),
            _ => processor.dispatch(#[inline(always)] || $function::<64>($($argument),*)),
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
        wide!(*width, carry(data, spare, transition));
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
        wide!(*width, grow(data, spare, transition, noise));
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
        wide!(*width, correct(data, spare, readings, own, gain))
    }

    /// Takes readings into sensitivities: `d` has how they change where the state does not, and afterwards how their innovations do.
    pub fn take_in(&mut self, readings: &Sparse, gain: &Gain, d: &mut Self) {
        wide!(self.width, take_in(&mut self.data, readings, gain, &mut d.data));
    }

    /// X <- scale A X into another, without a one in A.
    pub fn multiply(&self, a: &Sparse, scale: f64, to: &mut Self) {
        wide!(self.width, multiply(&self.data, a, scale, &mut to.data));
    }

    /// X + X^T of the first rows and columns, into another.
    pub fn add_transposed(&self, size: usize, to: &mut Self) {
        wide!(self.width, add_transposed(&self.data, size, &mut to.data));
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
    for (to, of) in to.iter_mut().zip(of) {
        *to += x * of;
    }
}

#[inline(always)]
fn carry<const W: usize>(data: &mut [f64], spare: &mut [f64], transition: &Sparse) {
    let (x, behind) = (data.as_chunks_mut::<W>().0, spare.as_chunks_mut::<W>().0);
    for ((row, to), own) in transition.rows().zip(behind.iter_mut()).zip(x.iter()) {
        let mut sum = *own;
        row.iter().for_each(|(k, f)| add_scaled(&mut sum, *f, &x[*k]));
        *to = sum;
    }
    let moving = transition.count();
    x[..moving].copy_from_slice(&behind[..moving]);
}

#[inline(always)]
fn multiply<const W: usize>(data: &[f64], a: &Sparse, scale: f64, to: &mut [f64]) {
    let (x, to) = (data.as_chunks::<W>().0, to.as_chunks_mut::<W>().0);
    for (row, to) in a.rows().zip(to) {
        let mut sum = [0.0; W];
        row.iter().for_each(|(k, f)| add_scaled(&mut sum, scale * f, &x[*k]));
        *to = sum;
    }
}

#[inline(always)]
fn add_transposed<const W: usize>(data: &[f64], size: usize, to: &mut [f64]) {
    let (x, to) = (data.as_chunks::<W>().0, to.as_chunks_mut::<W>().0);
    for i in 0..size {
        for k in 0..=i {
            let both = x[i][k] + x[k][i];
            (to[i][k], to[k][i]) = (both, both);
        }
    }
}

#[inline(always)]
fn grow<const W: usize>(data: &mut [f64], spare: &mut [f64], transition: &Sparse, noise: &[f64]) {
    let (p, noise) = (data.as_chunks_mut::<W>().0, noise.as_chunks::<W>().0);
    let (behind, across) = spare.as_chunks_mut::<W>().0.split_at_mut(p.len());
    let moving = transition.count();
    // F P, of what moves; what stays beside it is then as it should be.
    for ((row, to), own) in transition.rows().zip(behind.iter_mut()).zip(p.iter()) {
        let mut sum = *own;
        row.iter().for_each(|(k, f)| add_scaled(&mut sum, *f, &p[*k]));
        *to = sum;
    }
    for i in 0..moving {
        for k in 0..moving {
            across[k][i] = behind[i][k];
        }
    }
    // F (F P)^T.
    for (i, row) in transition.rows().enumerate() {
        let mut sum = across[i];
        row.iter().for_each(|(k, f)| add_scaled(&mut sum, *f, &across[*k]));
        p[i][..moving].copy_from_slice(&sum[..moving]);
        p[i][moving..].copy_from_slice(&behind[i][moving..]);
    }
    for i in moving..p.len() {
        for k in 0..moving {
            p[i][k] = p[k][i];
        }
    }
    for i in 0..moving {
        for k in 0..i {
            let mean = 0.5 * (p[i][k] + p[k][i]);
            (p[i][k], p[k][i]) = (mean, mean);
        }
    }
    for (row, noise) in p.iter_mut().zip(noise) {
        add_scaled(row, 1.0, noise);
    }
}

#[inline(always)]
fn correct<const W: usize>(
    data: &mut [f64],
    spare: &mut [f64],
    readings: &Sparse,
    own: &[f64],
    gain: &mut Gain,
) -> bool {
    let (p, across) = (data.as_chunks_mut::<W>().0, spare.as_chunks_mut::<W>().0);
    let size = p.len();
    for (r, (by_state, own)) in readings.rows().zip(own).enumerate() {
        // P h^T as the readings before have left P.
        let mut a = [0.0; W];
        by_state.iter().for_each(|(i, h)| add_scaled(&mut a, *h, &p[*i]));
        for q in 0..r {
            let coupling = dot(by_state, gain.of(q));
            gain.couplings.push(coupling);
            add_scaled(&mut a, -coupling, &across[q]);
        }
        let variance = dot(by_state, &a) + own;
        if !(variance > 0.0 && variance.is_finite()) {
            return false;
        }
        let inverse = 1.0 / variance;
        gain.gains.extend(a[..size].iter().map(|a| a * inverse));
        gain.variances.push(variance);
        across[r] = a;
    }
    for (i, row) in p.iter_mut().enumerate() {
        let mut sum = *row;
        for (r, a) in across.iter().enumerate() {
            add_scaled(&mut sum, -gain.of(r)[i], a);
        }
        *row = sum;
    }
    for i in 0..size {
        for k in 0..i {
            let mean = 0.5 * (p[i][k] + p[k][i]);
            (p[i][k], p[k][i]) = (mean, mean);
        }
    }
    true
}

#[inline(always)]
fn take_in<const W: usize>(data: &mut [f64], readings: &Sparse, gain: &Gain, d: &mut [f64]) {
    let (x, d) = (data.as_chunks_mut::<W>().0, d.as_chunks_mut::<W>().0);
    for (r, by_state) in readings.rows().enumerate() {
        let mut sum = d[r];
        by_state.iter().for_each(|(i, h)| add_scaled(&mut sum, -h, &x[*i]));
        for (q, coupling) in gain.couplings(r).iter().enumerate().filter(|(_, x)| **x != 0.0) {
            add_scaled(&mut sum, -coupling, &d[q]);
        }
        d[r] = sum;
    }
    for (i, row) in x.iter_mut().enumerate() {
        let mut sum = *row;
        for (r, d) in d.iter().enumerate().take(gain.count()) {
            add_scaled(&mut sum, gain.of(r)[i], d);
        }
        *row = sum;
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
