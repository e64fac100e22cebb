//! Allowed ranges of numbers.

use std::ops::{Bound, RangeBounds};

use crate::value::double_for_people;

/// What a numeric parameter may be. Make one with [`range`], [`positive`], [`non_negative`] or
/// [`any`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits<T> {
    lower: Bound<T>,
    upper: Bound<T>,
    finite: bool,
}

/// Numbers (f64 or i64) of a range: `range(0.0..=1.0)`, `range(1..)`. Finite unless
/// [`Limits::or_not_finite`].
#[must_use]
pub fn range<T: Copy>(bounds: impl RangeBounds<T>) -> Limits<T> {
    Limits { lower: bounds.start_bound().cloned(), upper: bounds.end_bound().cloned(), finite: true }
}

/// Numbers above zero.
#[must_use]
pub fn positive() -> Limits<f64> {
    range((Bound::Excluded(0.0), Bound::Unbounded))
}

/// Numbers of at least zero.
#[must_use]
pub fn non_negative() -> Limits<f64> {
    range(0.0..)
}

/// Every finite number.
#[must_use]
pub fn any<T: Copy>() -> Limits<T> {
    range(..)
}

impl Limits<f64> {
    /// Also allows NaN and infinities of either sign.
    #[must_use]
    pub fn or_not_finite(mut self) -> Self {
        self.finite = false;
        self
    }

    /// Whether a value is allowed.
    #[must_use]
    pub fn allows(&self, x: f64) -> bool {
        if x.is_finite() { (self.lower, self.upper).contains(&x) } else { !self.finite }
    }

    /// Inclusive ends for `rcl_interfaces/msg/FloatingPointRange`; infinite where open.
    #[must_use]
    pub fn ends(&self) -> (f64, f64) {
        let lower = match self.lower {
            Bound::Included(x) => x,
            Bound::Excluded(x) => x.next_up(),
            Bound::Unbounded => f64::NEG_INFINITY,
        };
        let upper = match self.upper {
            Bound::Included(x) => x,
            Bound::Excluded(x) => x.next_down(),
            Bound::Unbounded => f64::INFINITY,
        };
        (lower, upper)
    }

    /// In words: `from 0 to 1`, `above 0`; empty when every number is allowed.
    pub(crate) fn words(&self) -> String {
        let words = in_words(self.lower, self.upper, double_for_people);
        match (words.is_empty(), self.finite) {
            (_, true) => words,
            (true, false) => "or .nan, .inf, -.inf".into(),
            (false, false) => format!("{words}, or .nan, .inf, -.inf"),
        }
    }

    /// An allowed value to continue with after an error: near 1 if possible.
    pub(crate) fn placeholder(&self) -> f64 {
        let (lower, upper) = self.ends();
        1.0_f64.min(upper).max(lower)
    }
}

impl Limits<i64> {
    /// Whether a value is allowed.
    #[must_use]
    pub fn allows(&self, x: i64) -> bool {
        (self.lower, self.upper).contains(&x)
    }

    /// Inclusive ends for `rcl_interfaces/msg/IntegerRange`.
    #[must_use]
    pub fn ends(&self) -> (i64, i64) {
        let lower = match self.lower {
            Bound::Included(x) => x,
            Bound::Excluded(x) => x.saturating_add(1),
            Bound::Unbounded => i64::MIN,
        };
        let upper = match self.upper {
            Bound::Included(x) => x,
            Bound::Excluded(x) => x.saturating_sub(1),
            Bound::Unbounded => i64::MAX,
        };
        (lower, upper)
    }

    pub(crate) fn words(&self) -> String {
        let (lower, upper) = self.ends();
        let lower = if lower == i64::MIN { Bound::Unbounded } else { Bound::Included(lower) };
        let upper = if upper == i64::MAX { Bound::Unbounded } else { Bound::Included(upper) };
        in_words(lower, upper, |x| x.to_string())
    }

    pub(crate) fn placeholder(&self) -> i64 {
        let (lower, upper) = self.ends();
        1.min(upper).max(lower)
    }
}

fn in_words<T>(lower: Bound<T>, upper: Bound<T>, text: impl Fn(T) -> String) -> String {
    let low = match lower {
        Bound::Included(x) => Some((text(x), true)),
        Bound::Excluded(x) => Some((text(x), false)),
        Bound::Unbounded => None,
    };
    let high = match upper {
        Bound::Included(x) => Some((text(x), true)),
        Bound::Excluded(x) => Some((text(x), false)),
        Bound::Unbounded => None,
    };
    match (low, high) {
        (None, None) => String::new(),
        (Some((x, true)), None) => format!("of at least {x}"),
        (Some((x, false)), None) => format!("above {x}"),
        (None, Some((x, true))) => format!("of at most {x}"),
        (None, Some((x, false))) => format!("below {x}"),
        (Some((a, true)), Some((b, true))) => format!("from {a} to {b}"),
        (Some((a, true)), Some((b, false))) => format!("from {a} to below {b}"),
        (Some((a, false)), Some((b, true))) => format!("above {a}, up to {b}"),
        (Some((a, false)), Some((b, false))) => format!("above {a} and below {b}"),
    }
}
