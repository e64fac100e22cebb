//! What is left of runs that a model is held against: sums of normalised innovations over longer and longer stretches.
//!
//! The model goes without a random torque. If a slow torque is missing, the sums grow with the stretch; of noise alone each has the
//! variance of its number of terms.

use std::collections::BTreeMap;

use whorl_prediction::Innovation;
use whorl_recording::Component;

/// Stretches over which is summed \[s\].
const WINDOWS_S: [f64; 2] = [1.0, 8.0];

/// Squares of sums, over what noise gives.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Remains {
    square: f64,
    count: f64,
}

impl Remains {
    /// Both.
    pub fn and(self, other: Self) -> Self {
        Self { square: self.square + other.square, count: self.count + other.count }
    }

    /// Root mean square, 1 of noise alone; 1 where nothing was read.
    pub fn times_the_noise(&self) -> f64 {
        if self.count < 1.0 { 1.0 } else { (self.square / self.count).sqrt() }
    }

    /// Deviations by which it exceeds noise alone.
    pub fn significance(&self) -> f64 {
        if self.count < 1.0 { 0.0 } else { (self.square - self.count) / (2.0 * self.count).sqrt() }
    }
}

/// Sums on the way through a run: of each component and window the number of the stretch, the sum in it and its terms.
#[derive(Default)]
pub(super) struct Sums {
    ended: Remains,
    open: BTreeMap<Component, [(i64, f64, f64); 2]>,
}

impl Sums {
    pub fn add(&mut self, innovation: &Innovation, value: f64) {
        let open = self.open.entry(innovation.component).or_default();
        for (slot, window_s) in open.iter_mut().zip(WINDOWS_S) {
            let stretch = (innovation.time_s / window_s).floor() as i64;
            if stretch != slot.0 {
                self.ended = self.ended.and(of_sum(*slot));
                *slot = (stretch, 0.0, 0.0);
            }
            slot.1 += value;
            slot.2 += 1.0;
        }
    }

    pub fn end(self) -> Remains {
        self.open.into_values().flatten().fold(self.ended, |all, slot| all.and(of_sum(slot)))
    }
}

fn of_sum((_, sum, terms): (i64, f64, f64)) -> Remains {
    if terms > 0.0 { Remains { square: sum * sum / terms, count: 1.0 } } else { Remains::default() }
}
