//! What readings say of the state at an instant before them.
//!
//! The backward recursion of Modified Bryson and Frazier, gathered while the filter goes forward, so that nothing has to be kept of
//! single readings, and no covariance has to be inverted: G. Bierman, "Fixed interval smoothing with discrete measurements",
//! *Int. J. Control* 18 (1973) 65.

use nalgebra::{DMatrix, DVector};

use crate::transition::add_product_transposed;

/// Of the readings since an instant. With x and P the filter's state and covariance there, before these readings, the readings
/// move the state to x + P `slope` and leave P - P `information` P.
#[derive(Debug, Clone)]
pub(crate) struct Since {
    /// How an error of the filter moves from the instant to the present, readings included: instant by present.
    pub transition: DMatrix<f64>,
    /// Sum of a e/S, a = d reading/d state at the instant, through the filter's gains in between.
    pub slope: DVector<f64>,
    /// Sum of a a^T/S.
    pub information: DMatrix<f64>,
}

impl Since {
    /// From now on, of a state of this size.
    pub fn now(size: usize) -> Self {
        Self {
            transition: DMatrix::identity(size, size),
            slope: DVector::zeros(size),
            information: DMatrix::zeros(size, size),
        }
    }

    /// Over a step that carries errors of the first coordinates by `phi`; the others stay.
    pub fn carry(&mut self, phi: &DMatrix<f64>) {
        let mut moved = DMatrix::zeros(self.transition.nrows(), phi.nrows());
        add_product_transposed(&mut moved, &self.transition, phi);
        self.transition.columns_mut(0, phi.nrows()).copy_from(&moved);
    }

    /// Nothing is uncertain of a coordinate from now on.
    pub fn hold(&mut self, coordinate: usize) {
        self.transition.column_mut(coordinate).fill(0.0);
    }

    /// A number was read: its derivative by the present state, its innovation with the variance of that, and the filter's gain.
    pub fn learn(&mut self, by_state: &DVector<f64>, value: f64, variance: f64, gain: &DVector<f64>) {
        let mut a = DVector::zeros(self.slope.len());
        for (i, h) in by_state.iter().enumerate().filter(|(_, h)| **h != 0.0) {
            a.axpy(*h, &self.transition.column(i), 1.0);
        }
        self.slope.axpy(value / variance, &a, 1.0);
        self.information.ger(1.0 / variance, &a, &a, 1.0);
        self.transition.ger(-1.0, &a, gain, 1.0);
    }

    /// The same of all readings to the end, where `later` is what those behind say of the state at the present instant.
    #[must_use]
    pub fn and(mut self, later: &Self) -> Self {
        self.slope.gemv(1.0, &self.transition, &later.slope, 1.0);
        self.information += &self.transition * &later.information * self.transition.transpose();
        self
    }
}
