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

mod constants;
mod gain;
mod gram;
mod kernels;
mod sparse;
mod transition;

pub use constants::Constants;
pub use gain::Gain;
pub use gram::Gram;
pub use kernels::Own;
pub use sparse::{Sparse, dot};
pub use transition::{Step, fastest_rate_1_s};

use kernels::{Add, AddTransposed, Carry, Correct, GoBack, Grow, Multiply, TakeIn};
use nalgebra::{DMatrix, Vector3};

/// Widths of rows: multiples of what processors handle at once. Columns of parameters go by blocks of [`BLOCK`].
const WIDTHS: [usize; 7] = [16, 20, 24, 28, 32, 48, 64];
/// Columns of parameters that are carried together.
pub const BLOCK: usize = 32;
/// Coordinates of a state at most: six of the body, sixteen hidden, eight wheels with their motors, nine of random torques, six biases.
pub const MOST_STATES: usize = 64;

/// Rows side by side.
#[derive(Debug, Clone)]
pub struct Lanes {
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
            20 => processor.dispatch($kernel::<20> { $($field: $value),* }),
            24 => processor.dispatch($kernel::<24> { $($field: $value),* }),
            28 => processor.dispatch($kernel::<28> { $($field: $value),* }),
            48 => processor.dispatch($kernel::<48> { $($field: $value),* }),
            32 => processor.dispatch($kernel::<32> { $($field: $value),* }),
            _ => processor.dispatch($kernel::<64> { $($field: $value),* }),
        }
    }};
}

/// A turn without what is about an axis.
pub fn level(turn: &mut [f64], axis: &Vector3<f64>) {
    let about: f64 = turn.iter().zip(axis).map(|(x, a)| x * a).sum();
    turn.iter_mut().zip(axis).for_each(|(x, a)| *x -= about * a);
}

impl Lanes {
    /// Zeros, with room for at least so many numbers in a row, at most [`MOST_STATES`].
    pub fn zeros(rows: usize, least: usize) -> Self {
        let width = WIDTHS.into_iter().find(|width| least <= *width).unwrap_or(MOST_STATES);
        Self { width, data: vec![0.0; rows * width], spare: Vec::new() }
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

    /// The variance of a product with a state whose covariance this is.
    pub fn variance(&self, row: &[(usize, f64)]) -> f64 {
        row.iter().map(|(i, by)| by * dot(row, self.row(*i))).sum()
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
            level(&mut row[..3], axis);
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

    /// Goes back over the readings of an instant, the last first, with the gradient g of log p by the state behind them and its variance, this N:
    ///
    /// ```text
    /// v = e/S - k g     V = 1/S + k N k     g <- g + h v     N <- (1 - h k) N (1 - k h) + h h/S
    /// ```
    ///
    /// `own`: the innovations e, and afterwards v with its variance V, the gradient by the error of each reading.
    pub fn take_out(&mut self, readings: &Sparse, gain: &Gain, gradient: &mut [f64], own: &mut [Own]) {
        let Self { width, data, .. } = self;
        wide!(*width, GoBack { data: data, gradient: gradient, readings: readings, gain: gain, own: own });
    }

    /// X <- scale A X into another, without a one in A.
    pub fn multiply(&self, a: &Sparse, scale: f64, to: &mut Self) {
        wide!(self.width, Multiply { data: &self.data, a: a, scale: scale, to: &mut to.data });
    }

    /// X + X^T of the first rows and columns, into another.
    pub fn add_transposed(&self, size: usize, to: &mut Self) {
        wide!(self.width, AddTransposed { data: &self.data, size: size, to: &mut to.data });
    }

    /// Adds another of the same shape; what is largest of that, whatever its sign.
    pub fn add(&mut self, other: &Self) -> f64 {
        wide!(self.width, Add { data: &mut self.data, other: &other.data })
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

#[cfg(test)]
mod tests;
