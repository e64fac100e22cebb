//! Where explanations are looked for: the model at a point, and the regression there.

use crate::evidence::problem::{Dataset, Problem};
use crate::explanations::candidates::Layout;
use crate::explanations::lines::Lines;
use crate::parameters::available::Available;

/// A problem, and the whitened regression of a layout's columns.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    pub problem: &'a Problem,
    pub available: &'a Available,
    /// Rhythms that were found so far.
    pub lines: &'a Lines,
    /// Wheels whose turning shows in the samples themselves: their rhythm has a name.
    pub turning: &'a [usize],
    pub layout: &'a Layout,
    pub data: &'a Dataset,
}
