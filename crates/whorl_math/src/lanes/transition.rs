//! The motion of small errors over a step.

use nalgebra::{DMatrix, Vector3};

use super::{Lanes, MOST_STATES, Sparse};

/// The series ends where a term is below this share of one: gains then err by less than their eighth digit.
const SMALLEST_TERM: f64 = 1e-9;
/// The same of what a step adds, of its largest number: levels of noise are known to some per cent.
const SMALLEST_TERM_ADDED: f64 = 1e-6;
/// Terms at most; steps are short against the fastest motion, so that far fewer are needed.
const MOST_TERMS: usize = 30;
/// Products with which the fastest rate is found: its error then is some per cent, a fifth where units differ a thousandfold.
const PRODUCTS: usize = 8;
/// The last of them, an even number.
const COUNTED: usize = 4;

/// What a step does to errors of what moves.
#[derive(Debug, Clone)]
pub struct Step {
    /// F less one: an error behind the step by one before it.
    pub transition: Sparse,
    /// Covariance that the step adds, and the part of it that is the model's own, without disturbances, if anybody asks.
    pub noise: Lanes,
    /// See there.
    pub of_model: Lanes,
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
            noise: room.clone(),
            of_model: room.clone(),
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

    /// With these derivatives [1/s], over a time \[s\]; driven by white noise, of which each coordinate gains so much variance in a second by itself, and
    /// by that part of it which is the model's own, if anybody asks. Both with noise of turns of the first three, about three axes together: roots of
    /// densities [rad per root of a second].
    pub fn make(
        &mut self,
        a: &DMatrix<f64>,
        density: &[f64],
        of_model: Option<&[f64]>,
        turns: &[Vector3<f64>],
        step_s: f64,
    ) {
        self.motion.clear();
        a.row_iter().for_each(|row| self.motion.push(row.iter().copied()));
        self.find_transition(step_s);
        let Self { motion, term, next, .. } = self;
        for (density, sum) in [(Some(density), &mut self.noise), (of_model, &mut self.of_model)] {
            if let Some(density) = density {
                add_noise(motion, [term, next], density, turns, step_s, sum);
            }
        }
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
        // What is beside the columns is no number either where a motion is none.
        (0..moving).for_each(|i| self.transition.push(self.sum.row(i)[..moving].iter().copied()));
    }
}

/// Covariance that dx/dt = A x + G n adds, with independent white noise n of density one: h D + h^2/2 L D + h^3/6 L (L D) + ..., with D = G G^T
/// and L X = A X + X A^T.
fn add_noise(
    motion: &Sparse,
    [term, next]: [&mut Lanes; 2],
    density: &[f64],
    turns: &[Vector3<f64>],
    step_s: f64,
    sum: &mut Lanes,
) {
    let moving = motion.count();
    term.clear(moving);
    for (i, density) in density.iter().enumerate() {
        term.row_mut(i)[i] = step_s * density;
    }
    for turn in turns {
        for (i, x) in turn.iter().enumerate() {
            let row = term.row_mut(i);
            (0..3).for_each(|k| row[k] += step_s * x * turn[k]);
        }
    }
    sum.clear(moving);
    let least = SMALLEST_TERM_ADDED * sum.add(term);
    for k in 2..=MOST_TERMS {
        term.multiply(motion, step_s / k as f64, next);
        next.add_transposed(moving, term);
        if least == 0.0 || sum.add(term) < least {
            break;
        }
    }
}

/// The largest size of an eigenvalue, roughly, by powers: whatever the units of the coordinates [1/s].
pub fn fastest_rate_1_s(a: &DMatrix<f64>) -> f64 {
    let size = a.nrows().min(MOST_STATES);
    let mut v: [f64; MOST_STATES] =
        std::array::from_fn(|i| if i < size { 1.0 + 0.1 * i as f64 } else { 0.0 });
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    // The first products still show the units of the start. What swings goes to and fro between an angle and its rate, and one product says how their units
    // differ: two do not.
    let mut growth = 1.0;
    for k in 0..PRODUCTS {
        let mut next = [0.0; MOST_STATES];
        for (column, x) in a.column_iter().zip(&v) {
            next.iter_mut().zip(&column).for_each(|(sum, a)| *sum += a * x);
        }
        let (size, before) = (norm(&next), norm(&v));
        if !(size > 0.0 && size.is_finite()) {
            return 0.0;
        }
        if k >= PRODUCTS - COUNTED {
            growth *= size / before;
        }
        v = next.map(|x| x / size);
    }
    growth.powf(1.0 / COUNTED as f64)
}
