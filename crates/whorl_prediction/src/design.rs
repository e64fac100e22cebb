//! The design matrix of a recording: how its innovations change with the parameters, kept from one pass for others close by.
//!
//! Innovations are white: where their changes are a little other than those that were kept, the slope errs by as small a share of a
//! deviation. A pass without columns then shows it at a tenth of the work.

use std::hash::{DefaultHasher, Hash, Hasher};

use nalgebra::{DMatrix, DVector, DVectorView};
use whorl_recording::Component;

use crate::sums::{Sums, Widening};

/// Bytes that are kept of a recording at most: six minutes at 100 Hz of nine numbers and 70 parameters. Longer ones are gone through with
/// columns each time.
const MOST_BYTES: usize = 96 << 20;

/// How normalised innovations change with the parameters, in the order in which they were taken in.
#[derive(Debug, Clone)]
pub(crate) struct Design {
    parameters: usize,
    /// Innovations by parameters, row by row; a share of 1e-7 is enough.
    rows: Vec<f32>,
    order: Order,
}

/// Which innovations were taken in, in which order.
#[derive(Debug, Clone, Default)]
pub(crate) struct Order(DefaultHasher);

impl Order {
    /// Another innovation: of which component, and which sample of its series.
    pub fn add(&mut self, component: Component, sample: usize) {
        (component, sample).hash(&mut self.0);
    }

    pub fn is_that_of(&self, other: &Self) -> bool {
        self.0.finish() == other.0.finish()
    }
}

impl Design {
    /// Of a recording with so many numbers; `None` if that is too much to keep.
    pub fn new(parameters: usize, numbers: usize) -> Option<Self> {
        let size = parameters.checked_mul(numbers).filter(|size| *size > 0 && size * 4 <= MOST_BYTES)?;
        Some(Self { parameters, rows: Vec::with_capacity(size), order: Order::default() })
    }

    /// The changes `d` of an innovation with this deviation.
    pub fn push(&mut self, d: DVectorView<'_, f64>, stddev: f64) {
        self.rows.extend(d.iter().map(|d| (d / stddev) as f32));
    }

    /// Adds what the n-th innovation says to d log p / dtheta.
    pub fn add_slope(&self, n: usize, normalised: f64, slope: &mut DVector<f64>) {
        let row = self.rows.get(n * self.parameters..).unwrap_or_default();
        slope.iter_mut().zip(row).for_each(|(slope, d)| *slope -= normalised * f64::from(*d));
    }
}

/// A design matrix, and what else of the pass does not depend on the innovations.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    pub design: Design,
    information: DMatrix<f64>,
    of_start: DMatrix<f64>,
    pub widening: Widening,
}

impl Kept {
    /// Of a pass in which innovations were taken in in this order.
    pub fn new(mut design: Design, order: Order, sums: &Sums, widening: Widening) -> Self {
        design.order = order;
        Self { design, information: sums.information.clone(), of_start: sums.of_start.clone(), widening }
    }

    /// No slope yet.
    pub fn no_slope(&self) -> DVector<f64> {
        DVector::zeros(self.design.parameters)
    }

    /// The sums of a pass close by, in which innovations were taken in in this order and which says this of its start; `None` where
    /// latencies have changed the order.
    pub fn sums(&self, slope: DVector<f64>, shift: &DVector<f64>, order: &Order) -> Option<Sums> {
        let slope = slope + &self.widening.of_slope * shift;
        let sums = Sums { information: self.information.clone(), slope, of_start: self.of_start.clone() };
        order.is_that_of(&self.design.order).then_some(sums)
    }
}
