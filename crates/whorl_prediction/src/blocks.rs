//! Columns of sensitivities side by side, and what is gathered of them.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_math::lanes::{BLOCK, Gain, Gram, Lanes, Sparse};

use crate::noise::Layout;
use crate::rows::Readings;

/// Columns of a filter's estimate: those of its state at the beginning, then others, which begin with nothing.
pub(crate) struct Blocks {
    /// Coordinates of the state at the beginning, if their columns are wanted.
    pub states: usize,
    plant: usize,
    width: usize,
    blocks: Vec<Block>,
    /// Sum of d d^T / S over all innovations e with d = de/dtheta: the information on the parameters.
    information: Gram,
    slope: DVector<f64>,
    /// Whether readings are means over a time in which columns are pushed, and how long that is so far \[s\].
    pub of_cells: bool,
    cell_s: f64,
    /// d / sqrt(S) of all innovations one after the other, if they are kept.
    pub design: Option<Vec<f32>>,
}

#[derive(Clone)]
struct Block {
    /// Of the filter's estimate, a row for each coordinate of the layout, per unit.
    of_state: Lanes,
    /// What is added over half of a step, to coordinates of the plant; all zeros: nothing.
    half: Lanes,
    is_pushed: bool,
    /// What was added since the readings before, if anybody asks.
    pushed: Lanes,
    /// Of the innovations of the present instant, a row each.
    d: Lanes,
}

impl Blocks {
    /// With or without columns of the state; so many others, and behind them so many of which those `apart` take no part together.
    pub fn new(layout: Layout, of_state: bool, parameters: usize, laws: usize, apart: usize) -> Self {
        let (size, plant) = (layout.size(), layout.plant.size());
        let states = if of_state { size } else { 0 };
        let count = states + parameters + laws;
        // One row of few columns, or blocks of many.
        let (blocks, least) = if count < BLOCK { (1, count.max(1)) } else { (count.div_ceil(BLOCK), BLOCK) };
        let [of_state, half, pushed, d] = [size, plant, plant, 0].map(|rows| Lanes::zeros(rows, least));
        let width = of_state.width();
        let mut blocks = vec![Block { of_state, half, is_pushed: false, pushed, d }; blocks];
        for i in 0..states {
            blocks[i / width].of_state.row_mut(i)[i % width] = 1.0;
        }
        let (information, slope) = (Gram::new(states + parameters, laws, apart), DVector::zeros(count));
        Self { states, plant, width, blocks, information, slope, of_cells: false, cell_s: 0.0, design: None }
    }

    pub fn count(&self) -> usize {
        self.slope.len()
    }

    /// At the end, of the state at the beginning, parameters, then laws: sum of d d^T / S, minus that of d e / S (d log p by each), and the design.
    pub fn said(self) -> (DMatrix<f64>, DVector<f64>, Option<Vec<f32>>) {
        (self.information.sum(), -self.slope, self.design)
    }

    #[inline(always)]
    pub fn at(&self, coordinate: usize, column: usize) -> f64 {
        self.blocks[column / self.width].of_state.row(coordinate)[column % self.width]
    }

    #[inline(always)]
    pub fn at_mut(&mut self, coordinate: usize, column: usize) -> &mut f64 {
        &mut self.blocks[column / self.width].of_state.row_mut(coordinate)[column % self.width]
    }

    pub fn rest(&mut self) {
        for block in self.blocks.iter_mut().filter(|block| block.is_pushed) {
            block.half.clear(self.plant);
            block.is_pushed = false;
        }
    }

    /// Adds to what is added to a column over half of the next step: s <- F (s + h/2 r) + h/2 r.
    #[inline(always)]
    pub fn push(&mut self, column: usize, coordinate: usize, half: f64) {
        let block = &mut self.blocks[column / self.width];
        block.is_pushed = true;
        block.half.row_mut(coordinate)[column % self.width] += half;
    }

    pub fn carry(&mut self, transition: &Sparse, step_s: f64) {
        self.cell_s += step_s;
        for Block { of_state, half, is_pushed, pushed, .. } in &mut self.blocks {
            if *is_pushed {
                of_state.add(half);
            }
            of_state.carry(transition);
            if *is_pushed {
                of_state.add(half);
            }
            if *is_pushed && self.of_cells {
                pushed.add(half);
                pushed.add(half);
            }
        }
    }

    /// Adds to what was added to a column since the readings before.
    #[inline(always)]
    pub fn add_pushed(&mut self, column: usize, coordinate: usize, by: f64) {
        self.blocks[column / self.width].pushed.row_mut(coordinate)[column % self.width] += by;
    }

    /// Readings that came before the present instant on average have seen so much less of what was added meanwhile.
    pub fn set_back(&mut self, readings: &Readings) {
        if !self.of_cells {
            return;
        }
        for Block { pushed, d, .. } in &mut self.blocks {
            for (r, row) in readings.rows.iter().enumerate().filter(|(_, row)| row.lag_s > 0.0) {
                let share = row.lag_s / self.cell_s.max(row.lag_s);
                let of_plant = readings.by_state.row(r).iter().filter(|(i, _)| *i < self.plant);
                for (i, x) in of_plant {
                    let (by, pushed) = (share * x, pushed.row(*i));
                    d.row_mut(r).iter_mut().zip(pushed).for_each(|(d, pushed)| *d += by * pushed);
                }
            }
            pushed.clear(self.plant);
        }
        self.cell_s = 0.0;
    }

    pub fn level(&mut self, axis: &Vector3<f64>) {
        self.blocks.iter_mut().for_each(|block| block.of_state.level(axis));
    }

    pub fn hold(&mut self, coordinate: usize) {
        self.blocks.iter_mut().for_each(|block| block.of_state.hold_row(coordinate));
    }

    /// So many readings of an instant, which do not change by themselves.
    pub fn clear_readings(&mut self, readings: usize) {
        self.blocks.iter_mut().for_each(|block| block.d.clear(readings));
    }

    /// How a reading less its prediction changes with a column where the state does not; behind [`Self::take_in`] how its innovation does.
    #[inline(always)]
    pub fn reading(&mut self, reading: usize, column: usize) -> &mut f64 {
        &mut self.blocks[column / self.width].d.row_mut(reading)[column % self.width]
    }

    pub fn take_in(&mut self, by_state: &Sparse, gain: &Gain, values: &[f64]) {
        for block in &mut self.blocks {
            block.of_state.take_in(by_state, gain, &mut block.d);
        }
        for (r, (value, variance)) in values.iter().zip(&gain.variances).enumerate() {
            let scale = 1.0 / variance.sqrt();
            let normalised = self.information.room();
            for (block, to) in self.blocks.iter().zip(normalised.chunks_mut(self.width)) {
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
}
