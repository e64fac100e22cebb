//! The way of a filter through a block of a recording, kept so that one can go back along it.

use nalgebra::Vector3;
use whorl_recording::Component;

use crate::gains::Gains;
use crate::lanes::Gain;
use crate::layout::Layout;
use crate::rows::Readings;

use super::packed::Packed;

/// Memory for a block at most \[bytes\]: two minutes or more of three sensors at 100 Hz, several times the longest correlation time.
const MOST_BYTES: usize = 24 << 20;

/// A step of the covariance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stride {
    pub step_s: f64,
    /// First row of F less one.
    pub transition: usize,
    /// Turns about it are of no consequence.
    pub unseen_axis: Option<Vector3<f64>>,
}

/// An instant at which something was read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instant {
    /// Behind its last stride, and behind its last reading.
    pub strides: usize,
    pub readings: usize,
    /// Coordinates of which nothing was uncertain on arrival, a bit each.
    pub held: u64,
}

/// The way of a filter through a block of a recording.
#[derive(Debug, Clone)]
pub(crate) struct Trail {
    pub(super) layout: Layout,
    /// It begins where the recording does.
    pub(super) is_first: bool,
    pub(super) strides: Vec<Stride>,
    /// F less one of those, one below the other.
    pub(super) transitions: Packed,
    pub(super) instants: Vec<Instant>,
    /// Derivatives of all readings by the state, components and innovations,
    pub(super) by_state: Packed,
    pub(super) components: Vec<Component>,
    pub(super) values: Vec<f64>,
    /// Their own variances,
    pub(super) own: Vec<f64>,
    /// and their gains, of which seven digits are enough.
    pub(super) gains: Vec<f32>,
    pub(super) couplings: Vec<f32>,
    pub(super) variances: Vec<f64>,
    pub(super) held: u64,
}

impl Trail {
    /// Of a filter that has not begun.
    pub(super) fn new(layout: Layout) -> Self {
        Self {
            layout,
            is_first: true,
            strides: Vec::new(),
            transitions: Packed::default(),
            instants: Vec::new(),
            by_state: Packed::default(),
            components: Vec::new(),
            values: Vec::new(),
            own: Vec::new(),
            gains: Vec::new(),
            couplings: Vec::new(),
            variances: Vec::new(),
            held: 0,
        }
    }

    /// Forgets this block: the next one begins here.
    pub(super) fn begin_next(&mut self) {
        self.is_first = false;
        self.strides.clear();
        self.transitions.clear();
        self.instants.clear();
        self.by_state.clear();
        self.components.clear();
        self.values.clear();
        self.own.clear();
        self.gains.clear();
        self.couplings.clear();
        self.variances.clear();
    }

    /// Whether there is no room for more.
    pub(super) fn is_full(&self) -> bool {
        // With the gradients on the way back.
        let driven = self.layout.moving() - self.layout.plant.size();
        let bytes = self.by_state.bytes()
            + self.transitions.bytes()
            + 4 * (self.gains.len() + self.couplings.len())
            + (size_of::<Stride>() + 16 * driven) * self.strides.len()
            + size_of::<Instant>() * self.instants.len()
            + (size_of::<Component>() + 40) * self.values.len();
        bytes >= MOST_BYTES
    }

    /// A step has ended.
    pub fn step(&mut self, step_ns: i64, gains: &Gains<'_>) {
        if gains.has_new_step || self.strides.is_empty() {
            self.transitions.append(&gains.step.transition);
        }
        let transition = self.transitions.count() - gains.step.transition.count();
        let step_s = step_ns as f64 * 1e-9;
        self.strides.push(Stride { step_s, transition, unseen_axis: gains.unseen_axis });
    }

    /// Nothing is uncertain of a coordinate on arrival at an instant.
    pub fn hold(&mut self, coordinate: usize) {
        self.held |= 1 << coordinate;
    }

    /// Readings of an instant with their innovations.
    pub fn take_in(&mut self, readings: &Readings, gain: &Gain, values: &[f64]) {
        self.by_state.append(&readings.by_state);
        self.components.extend(readings.rows.iter().map(|row| row.component));
        self.values.extend_from_slice(values);
        self.own.extend_from_slice(&readings.variances);
        gain.append_to(&mut self.gains, &mut self.couplings, &mut self.variances);
        let (strides, readings) = (self.strides.len(), self.values.len());
        self.instants.push(Instant { strides, readings, held: std::mem::take(&mut self.held) });
    }

    /// Rows of F less one of a stride.
    pub(super) fn transition(&self, stride: Stride) -> std::ops::Range<usize> {
        stride.transition..stride.transition + self.layout.moving()
    }

    /// Strides and readings before an instant.
    pub(super) fn before(&self, instant: usize) -> (usize, usize) {
        match instant.checked_sub(1).map(|before| self.instants[before]) {
            Some(before) => (before.strides, before.readings),
            None => (0, 0),
        }
    }
}
