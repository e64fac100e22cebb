//! What a pass says of parameters, as if its filter had begun with what was known before the run.

use nalgebra::{DMatrix, DVector};

use crate::known::KnownBefore;

/// What a pass says of parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sums {
    /// -d^2 log p / dtheta^2, Gauss and Newton's.
    pub information: DMatrix<f64>,
    /// d log p / dtheta.
    pub slope: DVector<f64>,
    /// How the start that the run shows moves with the parameters.
    pub of_start: DMatrix<f64>,
}

/// What it changes that a filter began with less than it was given.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Widening {
    /// How the start moves by how it moved.
    pub of_shift: DMatrix<f64>,
    /// What is added to the slope by how the start moved.
    pub of_slope: DMatrix<f64>,
}

impl Sums {
    /// As if the filter had begun with what was known before the run, `wide`, and not with what the run made of it, `narrow`, which
    /// holds the start where parameters would move it; and what that does to how the start moves and to the slope. `own` is the
    /// covariance of the start behind the run. With M the information that has been put in twice, a quadratic form of the start is
    /// taken out again:
    ///
    /// ```text
    /// start'       = (1 - own M)^-1 (shift + D theta)
    /// information' = information - D^T M (1 - own M)^-1 D
    /// slope'       = slope + D^T M (1 - own M)^-1 shift
    /// ```
    #[must_use]
    pub fn widened(
        mut self,
        own: &DMatrix<f64>,
        narrow: &DMatrix<f64>,
        wide: &DMatrix<f64>,
    ) -> (Self, Widening) {
        let size = own.nrows();
        let known = KnownBefore::new(wide);
        let n = known.back.nrows();
        let twice = known.units(narrow).try_inverse().map(|inverse| inverse - DMatrix::identity(n, n));
        let freed = twice.and_then(|twice| {
            let free = (DMatrix::identity(n, n) - known.units(own) * &twice).lu().solve(&known.back)?;
            Some((twice, free))
        });
        let Some((twice, free)) = freed else {
            let none = DMatrix::zeros(self.slope.len(), size);
            return (self, Widening { of_shift: DMatrix::identity(size, size), of_slope: none });
        };
        let of_slope = (&known.back * &self.of_start).transpose() * twice * &free;
        let of_shift = &known.basis * free;
        self.information -= &of_slope * &self.of_start;
        self.of_start = &of_shift * &self.of_start;
        (self, Widening { of_shift, of_slope })
    }

    /// Nothing is known.
    pub fn none(size: usize, parameters: usize) -> Self {
        Self {
            information: DMatrix::zeros(parameters, parameters),
            slope: DVector::zeros(parameters),
            of_start: DMatrix::zeros(size, parameters),
        }
    }
}
