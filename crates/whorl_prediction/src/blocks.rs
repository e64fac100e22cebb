//! Columns of sensitivities side by side, and what is gathered of them.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::noise::Layout;
use crate::rows::Readings;
use whorl_math::lanes::Gram;
use whorl_math::lanes::{BLOCK, Gain, Lanes, Sparse};

/// Columns of a filter's estimate: those of its state at the beginning, then others, which begin with nothing.
pub(crate) struct Blocks {
    /// Coordinates of the state at the beginning, if their columns are wanted.
    states: usize,
    plant: usize,
    blocks: Vec<Block>,
    /// Sum of d d^T / S over all innovations e with d = de/dtheta: the information on the parameters.
    information: Gram,
    slope: DVector<f64>,
    /// d / sqrt(S) of all innovations one after the other, if they are kept.
    pub design: Option<Vec<f32>>,
}

/// Columns that lie side by side.
#[derive(Clone)]
struct Block {
    /// Of the filter's estimate, a row for each coordinate of the layout, per unit.
    of_state: Lanes,
    /// What is added over half of a step, to coordinates of the plant; all zeros: nothing.
    half: Lanes,
    is_pushed: bool,
    /// Of the innovations of the present instant, a row each.
    d: Lanes,
}

/// What columns say at the end: of the state at the beginning first, then of parameters and laws.
#[derive(Default)]
pub(crate) struct Said {
    /// Sum of d d^T / S.
    pub information: DMatrix<f64>,
    /// Minus the sum of d e / S: d log p by each.
    pub slope: DVector<f64>,
    pub design: Option<Vec<f32>>,
}

impl Blocks {
    /// With or without columns of the state; so many others, and behind them so many of which those `apart` take no part together.
    pub fn new(layout: Layout, of_state: bool, parameters: usize, laws: usize, apart: usize) -> Self {
        let (size, plant) = (layout.size(), layout.plant.size());
        let states = if of_state { size } else { 0 };
        let count = states + parameters + laws;
        // One row of few columns, or blocks of many.
        let (blocks, least) = if count < BLOCK { (1, count.max(1)) } else { (count.div_ceil(BLOCK), BLOCK) };
        let block = Block {
            of_state: Lanes::zeros(size, least),
            half: Lanes::zeros(plant, least),
            is_pushed: false,
            d: Lanes::zeros(0, least),
        };
        let mut new = Self {
            states,
            plant,
            blocks: vec![block; blocks],
            information: Gram::new(states + parameters, laws, apart),
            slope: DVector::zeros(count),
            design: None,
        };
        let width = new.width();
        for i in 0..states {
            new.blocks[i / width].of_state.row_mut(i)[i % width] = 1.0;
        }
        new
    }

    /// How many there are, and how many of these are of the state at the beginning.
    pub fn count(&self) -> (usize, usize) {
        (self.slope.len(), self.states)
    }

    /// What was found of all innovations so far.
    pub fn said(self) -> Said {
        Said { information: self.information.sum(), slope: -self.slope, design: self.design }
    }

    /// How a coordinate of the present state changes with a column.
    #[inline(always)]
    pub fn at(&self, coordinate: usize, column: usize) -> f64 {
        let width = self.width();
        self.blocks[column / width].of_state.row(coordinate)[column % width]
    }

    #[inline(always)]
    pub fn set(&mut self, coordinate: usize, column: usize, x: f64) {
        let width = self.width();
        self.blocks[column / width].of_state.row_mut(coordinate)[column % width] = x;
    }

    /// Nothing is added over the next step.
    pub fn rest(&mut self) {
        for block in self.blocks.iter_mut().filter(|block| block.is_pushed) {
            block.half.clear(self.plant);
            block.is_pushed = false;
        }
    }

    /// Adds to what is added to a column over half of the next step: s <- F (s + h/2 r) + h/2 r.
    #[inline(always)]
    pub fn push(&mut self, column: usize, coordinate: usize, half: f64) {
        let width = self.width();
        let block = &mut self.blocks[column / width];
        block.is_pushed = true;
        block.half.row_mut(coordinate)[column % width] += half;
    }

    pub fn carry(&mut self, transition: &Sparse) {
        for block in &mut self.blocks {
            if block.is_pushed {
                block.of_state.add(&block.half);
            }
            block.of_state.carry(transition);
            if block.is_pushed {
                block.of_state.add(&block.half);
            }
        }
    }

    pub fn level(&mut self, axis: &Vector3<f64>) {
        self.blocks.iter_mut().for_each(|block| block.of_state.level(axis));
    }

    /// Nothing moves a coordinate.
    pub fn hold(&mut self, coordinate: usize) {
        self.blocks.iter_mut().for_each(|block| block.of_state.hold_row(coordinate));
    }

    /// So many readings of an instant, which do not change by themselves.
    pub fn clear_readings(&mut self, readings: usize) {
        self.blocks.iter_mut().for_each(|block| block.d.clear(readings));
    }

    /// How a reading less its prediction changes with a column where the state does not.
    #[inline(always)]
    pub fn set_reading(&mut self, column: usize, reading: usize, x: f64) {
        let width = self.width();
        self.blocks[column / width].d.row_mut(reading)[column % width] = x;
    }

    /// How the innovation of a reading of the present instant changes with a column.
    pub fn of_innovation(&self, reading: usize, column: usize) -> f64 {
        let width = self.width();
        self.blocks[column / width].d.row(reading)[column % width]
    }

    pub fn take_in(&mut self, readings: &Readings, gain: &Gain, values: &[f64]) {
        let width = self.width();
        // Nobody has read how they change by themselves.
        for block in &mut self.blocks {
            if block.d.rows() != readings.rows.len() {
                block.d.clear(readings.rows.len());
            }
            block.of_state.take_in(&readings.by_state, gain, &mut block.d);
        }
        for (r, (value, variance)) in values.iter().zip(&gain.variances).enumerate() {
            let scale = 1.0 / variance.sqrt();
            let normalised = self.information.room();
            for (block, to) in self.blocks.iter().zip(normalised.chunks_mut(width)) {
                to.iter_mut().zip(block.d.row(r)).for_each(|(to, d)| *to = d * scale);
            }
            let e = value * scale;
            self.slope.iter_mut().zip(normalised.iter()).for_each(|(slope, d)| *slope += e * d);
            if let Some(design) = &mut self.design {
                design.extend(normalised.iter().map(|d| *d as f32));
            }
            self.information.added();
        }
    }

    fn width(&self) -> usize {
        self.blocks[0].of_state.width()
    }
}
