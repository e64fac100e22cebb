//! Where explanations are looked for: the model at a point, and the regression there.

use crate::evidence::problem::{Dataset, Problem};
use crate::explanations::candidates::Design;
use crate::explanations::lines::Lines;
use crate::parameters::available::Available;

/// A problem, and the whitened regression with a design matrix.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    pub problem: &'a Problem,
    pub available: &'a Available,
    /// Periodicities that were found so far.
    pub lines: &'a Lines,
    /// Wheels whose turning shows in the samples themselves: their periodicity is explained.
    pub turning: &'a [usize],
    pub design: &'a Design,
    pub data: &'a Dataset,
}
