//! The design matrix of a recording: how its innovations change with the parameters, kept from one pass for others close by.
//!
//! Innovations are white: where their changes are a little other than those that were kept, the slope errs by as small a share of a
//! deviation. A pass without columns then shows it at a tenth of the work.

use nalgebra::DVector;

/// Bytes that are kept of a recording at most: six minutes at 100 Hz of nine numbers and 70 parameters. Longer ones are gone through with
/// columns each time.
const MOST_BYTES: usize = 96 << 20;

/// How normalised innovations change with the parameters, in the order in which they were taken in.
#[derive(Debug, Clone)]
pub(crate) struct Design {
    parameters: usize,
    /// Innovations by parameters, row by row; a share of 1e-7 is enough.
    rows: Vec<f32>,
}

impl Design {
    /// No slope yet.
    pub fn no_slope(&self) -> DVector<f64> {
        DVector::zeros(self.parameters)
    }

    /// Of a recording with so many numbers; `None` if that is too much to keep.
    pub fn new(parameters: usize, numbers: usize) -> Option<Self> {
        let size = parameters.checked_mul(numbers).filter(|size| *size > 0 && size * 4 <= MOST_BYTES)?;
        Some(Self { parameters, rows: Vec::with_capacity(size) })
    }

    /// The changes of an innovation over its deviation.
    pub fn push(&mut self, normalised: &[f64]) {
        self.rows.extend(normalised.iter().map(|d| *d as f32));
    }

    /// Adds what the n-th innovation says to d log p / dtheta.
    pub fn add_slope(&self, n: usize, normalised: f64, slope: &mut DVector<f64>) {
        let row = self.rows.get(n * self.parameters..).unwrap_or_default();
        slope.iter_mut().zip(row).for_each(|(slope, d)| *slope -= normalised * f64::from(*d));
    }
}
