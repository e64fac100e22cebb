//! A time in which something is there: a fault, a cut.

use crate::{Reader, range};

/// From a start, for a length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// From whatever times are counted from \[s\].
    pub start_s: f64,
    /// Length \[s\]; infinite: to the end.
    pub length_s: f64,
}

impl Span {
    /// Reads `length_s`, of something that may last to the end, behind a start that has been read.
    pub fn from_start(r: &mut Reader<'_>, start_s: f64) -> Self {
        let length_s = r.f64_or(
            "length_s",
            f64::INFINITY,
            range(0.0..).or_not_finite(),
            "for how long [s]; left out: to the end",
        );
        Self { start_s, length_s }
    }

    /// Whether it is there after so long \[s\]: from its start on, until just before its end.
    #[must_use]
    pub fn contains(&self, elapsed_s: f64) -> bool {
        (0.0..self.length_s).contains(&(elapsed_s - self.start_s))
    }
}
