//! Values over time.

/// Values at times. Times strictly increase; both vectors have the same length.
#[derive(Debug, Clone, PartialEq)]
pub struct Series<T> {
    /// Time since the start of the run \[s\].
    pub time_s: Vec<f64>,
    /// Value at each time.
    pub value: Vec<T>,
}

/// The number nearest to whole nanoseconds; a product with 1e-9 would be one of its neighbours.
pub(crate) fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

impl<T> Default for Series<T> {
    fn default() -> Self {
        Self { time_s: Vec::new(), value: Vec::new() }
    }
}

impl<T> Series<T> {
    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        self.value.len()
    }

    /// True if nothing was measured.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.value.is_empty()
    }

    /// The last value at or before `time_s` (zero-order hold); `None` before the first.
    #[must_use]
    pub fn held_at(&self, time_s: f64) -> Option<&T> {
        let after = self.time_s.partition_point(|t| *t <= time_s);
        after.checked_sub(1).and_then(|index| self.value.get(index))
    }
}

impl<T> FromIterator<(f64, T)> for Series<T> {
    /// Of pairs of time and value, which must come in order of time; a pair that does not is left out.
    fn from_iter<I: IntoIterator<Item = (f64, T)>>(pairs: I) -> Self {
        let mut series = Self::default();
        for (time_s, value) in pairs {
            if time_s.is_finite() && series.time_s.last().is_none_or(|last| time_s > *last) {
                series.time_s.push(time_s);
                series.value.push(value);
            }
        }
        series
    }
}
