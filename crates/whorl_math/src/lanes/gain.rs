//! Gains of the readings of an instant.

use super::Lanes;
use super::sparse::dot;

/// How the readings of an instant change the state, one after the other.
#[derive(Debug, Clone, Default)]
pub struct Gain {
    pub(super) size: usize,
    /// Of each reading, coordinate by coordinate.
    pub(super) gains: Vec<f64>,
    /// L, row by row below the diagonal.
    pub(super) couplings: Vec<f64>,
    /// Variances of the innovations.
    pub variances: Vec<f64>,
}

impl Gain {
    /// No readings yet, of a state of this size.
    pub fn clear(&mut self, size: usize) {
        self.size = size;
        self.gains.clear();
        self.couplings.clear();
        self.variances.clear();
    }

    /// How many readings there are.
    pub fn count(&self) -> usize {
        self.variances.len()
    }

    /// Appends the gain of a reading with these derivatives, behind those before it, and the variance of its innovation.
    pub fn push(&mut self, gain: impl Iterator<Item = f64>, derivatives: &[(usize, f64)], variance: f64) {
        for before in 0..self.count() {
            self.couplings.push(dot(derivatives, self.of(before)));
        }
        self.gains.extend(gain);
        self.variances.push(variance);
    }

    /// Innovations over their deviations.
    pub fn normalise(&self, d: &mut Lanes) {
        for (r, variance) in self.variances.iter().enumerate() {
            let deviation = variance.sqrt();
            d.row_mut(r).iter_mut().for_each(|d| *d /= deviation);
        }
    }

    /// The gain of a reading.
    #[inline(always)]
    pub fn of(&self, reading: usize) -> &[f64] {
        &self.gains[reading * self.size..(reading + 1) * self.size]
    }

    /// How a reading's prediction has been changed by those before it, per their innovations.
    #[inline(always)]
    pub fn couplings(&self, reading: usize) -> &[f64] {
        let first = first_coupling(reading);
        &self.couplings[first..first + reading]
    }
}

/// Where the couplings of a reading begin.
#[inline(always)]
pub(super) fn first_coupling(reading: usize) -> usize {
    reading * reading.saturating_sub(1) / 2
}
