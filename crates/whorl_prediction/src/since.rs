//! What readings say of the state at an instant before them.
//!
//! The backward recursion of Modified Bryson and Frazier, gathered while the filter goes forward, so that nothing has to be kept of
//! single readings, and no covariance has to be inverted: G. Bierman, "Fixed interval smoothing with discrete measurements",
//! *Int. J. Control* 18 (1973) 65.

use nalgebra::{DMatrix, DVector};

/// Of the readings since an instant. With x and P the filter's state and covariance there, before these readings, the readings
/// move the state to x + P `slope` and leave P - P `information` P.
#[derive(Debug, Clone)]
pub(crate) struct Since {
    /// How an error of the filter at the instant moves to the present, readings included: present by instant.
    pub transition: DMatrix<f64>,
    /// Sum of a e/S, a = d reading/d state at the instant, through the filter's gains in between.
    pub slope: DVector<f64>,
    /// Sum of a a^T/S.
    pub information: DMatrix<f64>,
}

impl Since {
    /// Of none, of a state of this size.
    pub fn none(size: usize) -> Self {
        Self {
            transition: DMatrix::identity(size, size),
            slope: DVector::zeros(size),
            information: DMatrix::zeros(size, size),
        }
    }

    /// The same of all readings to the end, where `later` is what those behind say of the state at the present instant.
    #[must_use]
    pub fn and(mut self, later: &Self) -> Self {
        self.slope.gemv_tr(1.0, &self.transition, &later.slope, 1.0);
        self.information += self.transition.transpose() * &later.information * &self.transition;
        self
    }
}
