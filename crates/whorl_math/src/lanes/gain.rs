//! Gains of the readings of an instant.

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

impl Gain {
    /// Appends what it has to lists: gains, couplings, variances.
    pub fn append_to(&self, gains: &mut Vec<f32>, couplings: &mut Vec<f32>, variances: &mut Vec<f64>) {
        gains.extend(self.gains.iter().map(|x| *x as f32));
        couplings.extend(self.couplings.iter().map(|x| *x as f32));
        variances.extend(&self.variances);
    }

    /// How many numbers each of these lists has of so many readings.
    pub fn lengths(size: usize, count: usize) -> [usize; 3] {
        [count * size, first_coupling(count), count]
    }

    /// Takes that of so many readings back from lists, of gains and couplings, and of variances, each from a place on which it moves on.
    pub fn take_from(
        &mut self,
        size: usize,
        count: usize,
        [gains, couplings]: [&[f32]; 2],
        variances: &[f64],
        at: &mut [usize; 3],
    ) {
        let lengths = Self::lengths(size, count);
        let [of_gains, of_couplings, of_variances] = [0, 1, 2].map(|k| at[k]..at[k] + lengths[k]);
        self.clear(size);
        self.gains.extend(gains[of_gains].iter().map(|x| f64::from(*x)));
        self.couplings.extend(couplings[of_couplings].iter().map(|x| f64::from(*x)));
        self.variances.extend(&variances[of_variances]);
        at.iter_mut().zip(lengths).for_each(|(at, length)| *at += length);
    }
}
