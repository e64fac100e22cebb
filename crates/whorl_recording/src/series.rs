//! Values over time.

use std::any::Any;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

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

/// Seconds to the nearest nanosecond.
pub(crate) fn nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
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

/// A value as plain numbers, in the order of [`whorl_bag::Form`].
trait Numbers: Sized {
    fn numbers(&self) -> Vec<f64>;
    fn number(&self, index: usize) -> Option<f64> {
        self.numbers().get(index).copied()
    }
    /// `None` where their number is another than the value's.
    fn of(numbers: Vec<f64>) -> Option<Self>;
}

impl Numbers for f64 {
    fn numbers(&self) -> Vec<f64> {
        vec![*self]
    }
    fn of(numbers: Vec<f64>) -> Option<Self> {
        numbers.first().copied()
    }
}

impl Numbers for Vec<f64> {
    fn numbers(&self) -> Vec<f64> {
        self.clone()
    }
    fn number(&self, index: usize) -> Option<f64> {
        self.get(index).copied()
    }
    fn of(numbers: Vec<f64>) -> Option<Self> {
        Some(numbers)
    }
}

impl Numbers for Vector3<f64> {
    fn numbers(&self) -> Vec<f64> {
        self.as_slice().to_vec()
    }
    fn number(&self, index: usize) -> Option<f64> {
        self.get(index).copied()
    }
    fn of(numbers: Vec<f64>) -> Option<Self> {
        (numbers.len() == 3).then(|| Self::from_column_slice(&numbers))
    }
}

impl Numbers for UnitQuaternion<f64> {
    fn numbers(&self) -> Vec<f64> {
        vec![self.w, self.i, self.j, self.k]
    }
    fn of(numbers: Vec<f64>) -> Option<Self> {
        match numbers.as_slice() {
            // Readers of messages and files have seen to its length; here it keeps its bits.
            &[w, x, y, z] => Some(Self::new_unchecked(Quaternion::new(w, x, y, z))),
            _ => None,
        }
    }
}

/// The series of a channel, whatever its values are.
pub trait ChannelSeries {
    /// Itself, to be taken for the [`Series`] that it is.
    fn as_any(&self) -> &dyn Any;
    /// Time of each sample since the start of the run \[s\].
    fn time_s(&self) -> &[f64];
    /// The numbers of sample `k`, in SI units; empty behind the last.
    fn numbers(&self, k: usize) -> Vec<f64>;
    /// One of them.
    fn number(&self, k: usize, index: usize) -> Option<f64>;
    /// Replaces the samples: times \[s\] and numbers, in order of time. One that is not in order, or has another
    /// number of numbers than the channel, is left out.
    fn fill(&mut self, samples: &mut dyn Iterator<Item = (f64, Vec<f64>)>);
}

impl<T: Numbers + 'static> ChannelSeries for Series<T> {
    fn as_any(&self) -> &dyn Any {
        self
    }
    fn time_s(&self) -> &[f64] {
        &self.time_s
    }
    fn numbers(&self, k: usize) -> Vec<f64> {
        self.value.get(k).map_or_else(Vec::new, Numbers::numbers)
    }
    fn number(&self, k: usize, index: usize) -> Option<f64> {
        self.value.get(k)?.number(index)
    }
    fn fill(&mut self, samples: &mut dyn Iterator<Item = (f64, Vec<f64>)>) {
        *self = samples.filter_map(|(time_s, numbers)| Some((time_s, T::of(numbers)?))).collect();
    }
}
