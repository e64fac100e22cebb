//! The way of a filter through a recording, kept so that one can go back along it.

use std::sync::Arc;

use nalgebra::Vector3;
use whorl_math::lanes::{Gain, Sparse};
use whorl_recording::Component;

use crate::gains::Gains;
use crate::noise::Layout;
use crate::rows::Readings;

/// Memory of an entry of a sparse matrix \[bytes\].
const ENTRY: usize = size_of::<(usize, f64)>();
/// Memory for a block of a way at most \[bytes\]: a minute or more of three sensors at 100 Hz, at least twice the longest correlation time.
const MOST_BYTES: usize = 64 << 20;

/// A step of a filter's covariance.
#[derive(Debug, Clone)]
pub(crate) struct Stride {
    pub step_s: f64,
    /// F less one.
    pub transition: Arc<Sparse>,
    /// Turns about it are of no consequence.
    pub unseen_axis: Option<Vector3<f64>>,
}

/// What was taken in at an instant, and the way to it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Instant {
    pub strides: Vec<Stride>,
    /// Coordinates of which nothing was uncertain on arrival.
    pub held: Vec<usize>,
    /// Derivatives of the readings by the state, components, innovations and own variances,
    pub by_state: Sparse,
    pub components: Vec<Component>,
    pub values: Vec<f64>,
    pub own: Vec<f64>,
    /// and their gains.
    pub gain: Gain,
}

#[derive(Debug, Clone)]
pub(crate) struct Trail {
    pub layout: Layout,
    /// It begins where the recording does.
    pub is_first: bool,
    pub instants: Vec<Instant>,
    /// There is no room for more: from then on nothing is kept.
    pub is_full: bool,
    bytes: usize,
    /// The next instant, so far, and its last step.
    next: Instant,
    transition: Arc<Sparse>,
}

impl Trail {
    pub fn new(layout: Layout) -> Self {
        let (instants, next, transition) = (Vec::new(), Instant::default(), Arc::default());
        Self { layout, is_first: true, instants, is_full: false, bytes: 0, next, transition }
    }

    /// Forgets all of it: what follows begins here.
    pub fn begin_next(&mut self) {
        (self.is_first, self.is_full, self.bytes) = (false, false, 0);
        self.instants.clear();
    }

    pub fn step(&mut self, step_ns: i64, gains: &Gains) {
        if gains.has_new_step || self.transition.count() == 0 {
            self.transition = Arc::new(gains.step.transition.clone());
            self.bytes += ENTRY * self.transition.entries().count();
        }
        let (step_s, transition) = (step_ns as f64 * 1e-9, Arc::clone(&self.transition));
        self.next.strides.push(Stride { step_s, transition, unseen_axis: gains.unseen_axis });
    }

    pub fn hold(&mut self, coordinate: usize) {
        self.next.held.push(coordinate);
    }

    pub fn take_in(&mut self, readings: &Readings, gain: &Gain, values: &[f64]) {
        if self.is_full {
            return;
        }
        // With the gradients of a way back.
        let driven = self.layout.moving() - self.layout.plant.size();
        self.bytes += (size_of::<Stride>() + 16 * driven) * self.next.strides.len()
            + size_of::<Instant>()
            + (8 * self.layout.size() + 4 * ENTRY) * values.len()
            + ENTRY * readings.by_state.entries().count();
        self.instants.push(Instant {
            by_state: readings.by_state.clone(),
            components: readings.rows.iter().map(|row| row.component).collect(),
            values: values.to_vec(),
            own: readings.variances.clone(),
            gain: gain.clone(),
            ..std::mem::take(&mut self.next)
        });
        self.is_full = self.bytes >= MOST_BYTES;
    }
}
