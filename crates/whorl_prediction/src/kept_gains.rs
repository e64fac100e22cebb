//! Gains of a recording along a motion, as a filter finds them, kept.

use nalgebra::{DMatrix, Vector3};

use crate::gains::Gains;
use crate::lanes::{Gain, Sparse};
use crate::layout::Layout;

/// Memory for the gains of a recording at most \[bytes\]: half an hour of three sensors at 100 Hz.
const MOST_BYTES: usize = 256 << 20;

/// A step of the mean.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stride {
    pub end_ns: i64,
    /// Of the motors' columns.
    pub transition: usize,
    /// Turns about it are of no consequence.
    pub unseen_axis: Option<Vector3<f64>>,
}

/// Gains of a recording along a motion, kept for passes close by.
#[derive(Debug, Clone, Default)]
pub struct FrozenGains {
    known: DMatrix<f64>,
    pub(crate) strides: Vec<Stride>,
    /// Columns of F that say what the motors' disturbances move.
    pub(crate) transitions: Vec<Sparse>,
    /// How many readings were taken in at each instant,
    pub(crate) counts: Vec<u32>,
    /// and of all of them one after the other, gains and couplings, of which seven digits are enough, and variances.
    pub(crate) gains: Vec<f32>,
    pub(crate) couplings: Vec<f32>,
    pub(crate) variances: Vec<f64>,
}

impl FrozenGains {
    /// Covariance with which the filter began.
    pub fn known(&self) -> &DMatrix<f64> {
        &self.known
    }
}

/// Keeps the gains of a filter on its way.
pub(crate) struct Recorder {
    kept: FrozenGains,
    is_full: bool,
}

impl Recorder {
    /// Of a filter that begins with this covariance.
    pub fn new(known: DMatrix<f64>) -> Self {
        Self { kept: FrozenGains { known, ..FrozenGains::default() }, is_full: false }
    }

    /// A step has ended.
    pub fn step(&mut self, end_ns: i64, gains: &Gains<'_>, layout: Layout) {
        let motors = layout.motors();
        if !motors.is_empty() && gains.has_new_step || self.kept.transitions.is_empty() {
            let mut columns = Sparse::default();
            for row in gains.step.transition.rows().take(layout.plant.size()) {
                row.iter().filter(|(k, _)| motors.contains(k)).for_each(|(k, x)| columns.set(*k, *x));
                columns.end_row();
            }
            self.kept.transitions.push(columns);
        }
        let transition = self.kept.transitions.len() - 1;
        self.kept.strides.push(Stride { end_ns, transition, unseen_axis: gains.unseen_axis });
    }

    /// Readings of an instant.
    pub fn take_in(&mut self, gain: &Gain) {
        self.is_full |= self.kept.gains.len() * 4 > MOST_BYTES;
        if !self.is_full {
            self.kept.counts.push(gain.count() as u32);
            gain.append_to(&mut self.kept.gains, &mut self.kept.couplings, &mut self.kept.variances);
        }
    }

    /// What was kept; `None`: it would have been too much.
    pub fn end(self) -> Option<FrozenGains> {
        (!self.is_full).then_some(self.kept)
    }
}
