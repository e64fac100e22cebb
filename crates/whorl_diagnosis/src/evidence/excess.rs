//! What is left in a whitened residual: slow sums that noise alone would not give.

use crate::evidence::regression::Whitened;

/// Lengths of the windows over which the residual is summed \[s\].
pub(crate) const WINDOWS_S: [f64; 4] = [0.3, 1.0, 8.0, 30.0];

/// Sums of squares of normalised window sums and how many there are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Power {
    pub sum: f64,
    pub count: f64,
}

impl Power {
    pub fn add(&mut self, other: Self) {
        self.sum += other.sum;
        self.count += other.count;
    }

    /// Above what white noise gives.
    pub fn excess(&self) -> f64 {
        self.sum - self.count
    }

    /// In standard deviations of white noise's.
    pub fn significance(&self) -> f64 {
        if self.count < 1.0 { 0.0 } else { self.excess() / (2.0 * self.count).sqrt() }
    }

    pub fn rms(&self) -> f64 {
        if self.count < 1.0 { 0.0 } else { (self.sum / self.count).sqrt() }
    }
}

/// Power of a residual of one run over each window.
pub(crate) fn powers(whitened: &Whitened, residual: &[f64], duration_s: f64) -> [Power; WINDOWS_S.len()] {
    let mut powers = [Power::default(); WINDOWS_S.len()];
    let node_s = duration_s / whitened.nodes.max(1) as f64;
    for rows in whitened.rows_by_reading() {
        for (power, window_s) in powers.iter_mut().zip(WINDOWS_S) {
            let per_window = window_s / node_s;
            let (mut index, mut sum, mut count) = (usize::MAX, 0.0, 0.0);
            for row in &rows {
                let node = whitened.node.get(*row).copied().unwrap_or(0) as f64;
                let window = (node / per_window) as usize;
                if window != index {
                    if count > 0.0 {
                        power.add(Power { sum: sum * sum / count, count: 1.0 });
                    }
                    (index, sum, count) = (window, 0.0, 0.0);
                }
                // One wild sample is no slow torque.
                sum += residual.get(*row).copied().unwrap_or(0.0).clamp(-6.0, 6.0);
                count += 1.0;
            }
            if count > 0.0 {
                power.add(Power { sum: sum * sum / count, count: 1.0 });
            }
        }
    }
    powers
}
