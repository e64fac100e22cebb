//! The motion of small errors over a step.

use nalgebra::{DMatrix, Vector3};
use whorl_dynamics::plant::ROTATION;

use crate::lanes::{Lanes, MOST_STATES, Sparse};

/// The series ends where a term is below this share of one: gains then err by less than their eighth digit.
const SMALLEST_TERM: f64 = 1e-9;
/// The same of what a step adds, of its largest number: levels of noise are known to some per cent.
const SMALLEST_TERM_ADDED: f64 = 1e-6;
/// Terms at most; steps are short against the fastest motion, so that far fewer are needed.
const MOST_TERMS: usize = 30;
/// Products with which the fastest rate is found: its error then is some per cent.
const PRODUCTS: usize = 6;

/// White noise that drives what moves.
#[derive(Debug, Clone, Default)]
pub(crate) struct WhiteNoise {
    /// Variance that each coordinate gains in a second, by itself,
    pub density: Vec<f64>,
    /// and roots of those of turns of the body, together about three axes each [rad per root of a second].
    pub turns: Vec<Vector3<f64>>,
}

impl WhiteNoise {
    /// Whether there is none.
    fn is_none(&self) -> bool {
        self.turns.is_empty() && self.density.iter().all(|x| *x == 0.0)
    }
}

/// What a step does to errors of what moves.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    /// F less one: an error behind the step by one before it.
    pub transition: Sparse,
    /// Covariance that the step adds; `None` where nothing is random.
    pub noise: Option<Lanes>,
    /// The part of it that is the model's own, without disturbances; `None` where there is none, or nobody asks.
    pub of_model: Option<Lanes>,
    /// A of dx/dt = A x, and room for terms of series.
    motion: Sparse,
    term: Lanes,
    next: Lanes,
    sum: Lanes,
}

impl Step {
    /// Of so many coordinates that move, of a state of this size.
    pub fn new(moving: usize, size: usize) -> Self {
        let room = Lanes::zeros(moving, size);
        Self {
            transition: Sparse::default(),
            noise: None,
            of_model: None,
            motion: Sparse::default(),
            term: room.clone(),
            next: room.clone(),
            sum: room,
        }
    }

    /// A of dx/dt = A x over the step.
    pub fn motion(&self) -> &Sparse {
        &self.motion
    }

    /// With these derivatives [1/s], over a time \[s\]; driven by white noise, and by that part of it which is the model's own, if anybody
    /// asks.
    pub fn make(&mut self, a: &DMatrix<f64>, noise: &WhiteNoise, of_model: Option<&WhiteNoise>, step_s: f64) {
        self.motion.clear();
        a.row_iter().for_each(|row| self.motion.push(row.iter().copied()));
        self.find_transition(step_s);
        let [room, room_of_model] = [self.noise.take(), self.of_model.take()];
        self.noise = self.added(noise, step_s, room);
        self.of_model = of_model.and_then(|noise| self.added(noise, step_s, room_of_model));
    }

    /// exp(A h), by its series.
    fn find_transition(&mut self, step_s: f64) {
        let moving = self.motion.count();
        self.sum.clear(moving);
        self.term.clear(moving);
        (0..moving).for_each(|i| self.term.row_mut(i)[i] = 1.0);
        for k in 1..=MOST_TERMS {
            self.term.multiply(&self.motion, step_s / k as f64, &mut self.next);
            std::mem::swap(&mut self.term, &mut self.next);
            if self.sum.add(&self.term) < SMALLEST_TERM {
                break;
            }
        }
        self.transition.clear();
        (0..moving).for_each(|i| self.transition.push(self.sum.row(i).iter().copied()));
    }

    /// Covariance that dx/dt = A x + G n adds, with independent white noise n of density one; `None` where nothing is random:
    ///
    /// ```text
    /// Q = integral from 0 to h of exp(A s) G G^T exp(A s)^T ds
    ///   = h D + h^2/2 L D + h^3/6 L (L D) + ...,    D = G G^T,    L X = A X + X A^T
    /// ```
    fn added(&mut self, noise: &WhiteNoise, step_s: f64, room: Option<Lanes>) -> Option<Lanes> {
        if noise.is_none() {
            return None;
        }
        let moving = self.motion.count();
        self.term.clear(moving);
        for (i, density) in noise.density.iter().enumerate() {
            self.term.row_mut(i)[i] = step_s * density;
        }
        for turn in &noise.turns {
            for (i, x) in turn.iter().enumerate() {
                let row = self.term.row_mut(ROTATION.start + i);
                (0..3).for_each(|k| row[ROTATION.start + k] += step_s * x * turn[k]);
            }
        }
        let mut sum = room.unwrap_or_else(|| self.term.clone());
        sum.clear(moving);
        let least = SMALLEST_TERM_ADDED * sum.add(&self.term);
        for k in 2..=MOST_TERMS {
            self.term.multiply(&self.motion, step_s / k as f64, &mut self.next);
            self.next.add_transposed(moving, &mut self.term);
            if sum.add(&self.term) < least {
                break;
            }
        }
        Some(sum)
    }
}

/// The largest size of an eigenvalue, roughly, by powers: whatever the units of the coordinates [1/s].
pub(crate) fn fastest_rate_1_s(a: &DMatrix<f64>) -> f64 {
    let size = a.nrows().min(MOST_STATES);
    let mut v: [f64; MOST_STATES] =
        std::array::from_fn(|i| if i < size { 1.0 + 0.1 * i as f64 } else { 0.0 });
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut fastest: f64 = 0.0;
    for k in 0..PRODUCTS {
        let mut next = [0.0; MOST_STATES];
        for (column, x) in a.column_iter().zip(&v) {
            next.iter_mut().zip(&column).for_each(|(sum, a)| *sum += a * x);
        }
        let (size, before) = (norm(&next), norm(&v));
        if !(size > 0.0 && size.is_finite()) {
            break;
        }
        // The first products still show the units of the start.
        if k >= PRODUCTS / 2 {
            fastest = fastest.max(size / before);
        }
        v = next.map(|x| x / size);
    }
    fastest
}
