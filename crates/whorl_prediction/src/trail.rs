//! The way of a filter through a recording, kept: so that one can go back along it, and for passes close by with the same gains.

use nalgebra::{DMatrix, Vector3};
use whorl_math::lanes::{Gain, Packed};
use whorl_recording::Component;

use crate::gains::Gains;
use crate::noise::Layout;
use crate::rows::Readings;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Stride {
    pub end_ns: i64,
    pub step_s: f64,
    /// First row of F less one.
    pub transition: usize,
    /// Turns about it are of no consequence.
    pub unseen_axis: Option<Vector3<f64>>,
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Instant {
    /// Behind its last stride, and behind its last reading.
    pub strides: usize,
    pub readings: usize,
    /// Coordinates of which nothing was uncertain on arrival, a bit each.
    pub held: u64,
}

/// The way of a filter through a recording, or through a part of it: gains along a motion, and what they were made of.
#[derive(Debug, Clone)]
pub struct Trail {
    pub(crate) layout: Layout,
    /// Covariance with which the filter began.
    pub(crate) known: DMatrix<f64>,
    /// It begins where the recording does.
    pub(crate) is_first: bool,
    pub(crate) strides: Vec<Stride>,
    /// F less one of those, one below the other.
    pub(crate) transitions: Packed,
    pub(crate) instants: Vec<Instant>,
    /// Derivatives of all readings by the state, components and innovations,
    pub(crate) by_state: Packed,
    pub(crate) components: Vec<Component>,
    pub(crate) values: Vec<f64>,
    /// their own variances,
    pub(crate) own: Vec<f64>,
    /// and their gains, of which seven digits are enough.
    pub(crate) gains: Vec<f32>,
    pub(crate) couplings: Vec<f32>,
    pub(crate) variances: Vec<f64>,
    held: u64,
    most_bytes: usize,
    is_full: bool,
}

impl Trail {
    /// Of a filter that begins with this covariance; of no more than so much memory \[bytes\].
    pub(crate) fn new(layout: Layout, known: DMatrix<f64>, most_bytes: usize) -> Self {
        Self {
            layout,
            known,
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
            most_bytes,
            is_full: false,
        }
    }

    /// Forgets all of it: what follows begins here.
    pub(crate) fn begin_next(&mut self) {
        let known = std::mem::take(&mut self.known);
        *self = Self { is_first: false, ..Self::new(self.layout, known, self.most_bytes) };
    }

    /// Whether there is no room for more: from then on nothing is kept.
    pub(crate) fn is_full(&self) -> bool {
        self.is_full
    }

    fn bytes(&self) -> usize {
        // With the gradients of a way back.
        let driven = self.layout.moving() - self.layout.plant.size();
        self.by_state.bytes()
            + self.transitions.bytes()
            + 4 * (self.gains.len() + self.couplings.len())
            + (size_of::<Stride>() + 16 * driven) * self.strides.len()
            + size_of::<Instant>() * self.instants.len()
            + (size_of::<Component>() + 40) * self.values.len()
    }

    pub(crate) fn step(&mut self, end_ns: i64, step_ns: i64, gains: &Gains<'_>) {
        if self.is_full {
            return;
        }
        if gains.has_new_step || self.strides.is_empty() {
            self.transitions.append(&gains.step.transition);
        }
        let transition = self.transitions.count() - gains.step.transition.count();
        let step_s = step_ns as f64 * 1e-9;
        self.strides.push(Stride { end_ns, step_s, transition, unseen_axis: gains.unseen_axis });
    }

    /// Nothing is uncertain of a coordinate on arrival at an instant.
    pub(crate) fn hold(&mut self, coordinate: usize) {
        self.held |= 1 << coordinate;
    }

    /// Readings of an instant with their innovations.
    pub(crate) fn take_in(&mut self, readings: &Readings, gain: &Gain, values: &[f64]) {
        if self.is_full {
            return;
        }
        self.by_state.append(&readings.by_state);
        self.components.extend(readings.rows.iter().map(|row| row.component));
        self.values.extend_from_slice(values);
        self.own.extend_from_slice(&readings.variances);
        gain.append_to(&mut self.gains, &mut self.couplings, &mut self.variances);
        let (strides, readings) = (self.strides.len(), self.values.len());
        self.instants.push(Instant { strides, readings, held: std::mem::take(&mut self.held) });
        self.is_full = self.bytes() >= self.most_bytes;
    }

    pub(crate) fn transition(&self, stride: Stride) -> std::ops::Range<usize> {
        stride.transition..stride.transition + self.layout.moving()
    }

    pub(crate) fn before(&self, instant: usize) -> (usize, usize) {
        let before = instant.checked_sub(1).and_then(|before| self.instants.get(before));
        before.map_or((0, 0), |before| (before.strides, before.readings))
    }
}
