//! Readings of a cell, on the way to its end ([`crate::cells`]).

use nalgebra::Vector3;
use whorl_recording::Component;

use crate::rows::{Readings, Row};

/// Readings of a cell less their predictions, on the way to its end.
#[derive(Debug, Clone, Default)]
pub(crate) struct Collected {
    sums: Vec<Sum>,
}

#[derive(Debug, Clone)]
struct Sum {
    component: Component,
    track: usize,
    /// The last.
    sample: usize,
    count: f64,
    value: f64,
    /// The same of directions, sensor axes.
    along: Vector3<f64>,
    lag_s: f64,
    lag_squared_s2: f64,
}

impl Collected {
    pub fn clear(&mut self) {
        self.sums.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.sums.is_empty()
    }

    /// Adds what was read so long before the end \[s\].
    pub fn add(&mut self, readings: &Readings, lag_s: f64) {
        for row in &readings.rows {
            let known = self.sums.iter().position(|sum| sum.component == row.component);
            let k = known.unwrap_or_else(|| {
                self.sums.push(Sum::none(row));
                self.sums.len() - 1
            });
            let sum = &mut self.sums[k];
            sum.sample = row.sample;
            sum.count += 1.0;
            sum.value += row.value;
            sum.along += row.axis * row.value;
            sum.lag_s += lag_s;
            sum.lag_squared_s2 += lag_s * lag_s;
        }
    }

    /// The last of each sensor: track and sample.
    pub fn last(&self, due: &mut Vec<(usize, usize)>) {
        due.clear();
        for sum in &self.sums {
            match due.iter_mut().find(|(track, _)| *track == sum.track) {
                Some((_, sample)) => *sample = sum.sample.max(*sample),
                None => due.push((sum.track, sum.sample)),
            }
        }
        due.sort_unstable();
    }

    /// Means in the place of the last of each.
    pub fn put(&self, readings: &mut Readings) {
        for (row, variance) in readings.rows.iter_mut().zip(&mut readings.variances) {
            let Some(sum) = self.sums.iter().find(|sum| sum.component == row.component) else { continue };
            row.value = if row.axis == Vector3::zeros() {
                sum.value
            } else {
                let of_track = self.sums.iter().filter(|other| other.track == sum.track);
                of_track.map(|other| other.along.dot(&row.axis)).sum()
            } / sum.count;
            *variance /= sum.count;
            row.lag_s = sum.lag_s / sum.count;
            row.lag_squared_s2 = sum.lag_squared_s2 / sum.count;
        }
    }
}

impl Sum {
    fn none(row: &Row) -> Self {
        Self {
            component: row.component,
            track: row.track,
            sample: row.sample,
            count: 0.0,
            value: 0.0,
            along: Vector3::zeros(),
            lag_s: 0.0,
            lag_squared_s2: 0.0,
        }
    }
}
