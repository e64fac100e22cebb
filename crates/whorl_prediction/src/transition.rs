//! The motion of small errors over a step.

use nalgebra::{DMatrix, DVector};

use crate::lanes::{Lanes, Sparse};

/// The series ends where a term is below this share of one: gains then err by less than their tenth digit.
const SMALLEST_TERM: f64 = 1e-11;
/// Terms at most; steps are short against the fastest motion, so that far fewer are needed.
const MOST_TERMS: usize = 30;
/// Products with which the fastest rate is found: its error then is some per cent.
const PRODUCTS: usize = 6;

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

    /// With these derivatives [1/s], over a time \[s\]; driven by white noise, the columns of `roots` in the coordinates' units per root of
    /// a second, of which `of_model` are the model's own.
    pub fn make(
        &mut self,
        a: &DMatrix<f64>,
        roots: &DMatrix<f64>,
        of_model: Option<&DMatrix<f64>>,
        step_s: f64,
    ) {
        self.motion.clear();
        a.row_iter().for_each(|row| self.motion.push(row.iter().copied()));
        self.find_transition(step_s);
        let [noise, room] = [self.noise.take(), self.of_model.take()];
        self.noise = self.added(roots, step_s, noise);
        self.of_model = of_model.and_then(|roots| self.added(roots, step_s, room));
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
            self.sum.add(&self.term);
            if self.term.largest() < SMALLEST_TERM {
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
    fn added(&mut self, roots: &DMatrix<f64>, step_s: f64, room: Option<Lanes>) -> Option<Lanes> {
        if roots.ncols() == 0 {
            return None;
        }
        let moving = self.motion.count();
        self.term.clear(moving);
        for root in roots.column_iter() {
            for (i, x) in root.iter().enumerate().filter(|(_, x)| **x != 0.0) {
                let row = self.term.row_mut(i);
                root.iter().zip(row).for_each(|(y, slot)| *slot += step_s * x * y);
            }
        }
        let mut sum = room.unwrap_or_else(|| self.term.clone());
        sum.clear(moving);
        sum.add(&self.term);
        let least = SMALLEST_TERM * sum.largest();
        for k in 2..=MOST_TERMS {
            self.term.multiply(&self.motion, step_s / k as f64, &mut self.next);
            self.next.add_transposed(moving, &mut self.term);
            sum.add(&self.term);
            if self.term.largest() < least {
                break;
            }
        }
        Some(sum)
    }
}

/// The largest size of an eigenvalue, roughly, by powers: whatever the units of the coordinates [1/s].
pub(crate) fn fastest_rate_1_s(a: &DMatrix<f64>) -> f64 {
    let mut v = DVector::from_fn(a.nrows(), |i, _| 1.0 + 0.1 * i as f64);
    let mut fastest: f64 = 0.0;
    let mut next = v.clone();
    for k in 0..PRODUCTS {
        next.gemv(1.0, a, &v, 0.0);
        let (size, before) = (next.norm(), v.norm());
        if !(size > 0.0 && size.is_finite()) {
            break;
        }
        // The first products still show the units of the start.
        if k >= PRODUCTS / 2 {
            fastest = fastest.max(size / before);
        }
        next /= size;
        std::mem::swap(&mut v, &mut next);
    }
    fastest
}
