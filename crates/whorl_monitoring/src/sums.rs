//! What windows say together of parameters that began in one of them.
//!
//! Innovations e of a window, whitened, are linear in the parameters theta that began at a start s before it: with X how the filter's state at
//! the window's beginning changes with them, d the columns of the window's own parameters and d_x those of its state,
//!
//! ```text
//! de/dtheta = d + d_x X        X <- (transition) X + (moved)
//! G += (d + d_x X)^T (d + d_x X)        g -= (d + d_x X)^T e
//! ```
//!
//! so that the sums of a window are enough for every start. The platform's constants b began with the first window; they have the prior N(0, 1)
//! in their units, and are integrated out: with A = G_bb + 1,
//!
//! ```text
//! G' = G - G_tb A^-1 G_bt        g' = g - G_tb A^-1 g_b
//! ```

use nalgebra::{DMatrix, DVector};
use whorl_prediction::Window;

/// What was gathered since one start.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// X: of the filter's state by parameter.
    of_state: DMatrix<f64>,
    /// G: of the platform's constants by all, and of pairs of parameters.
    by_constants: DMatrix<f64>,
    pairs: Vec<f64>,
    /// g, and sums of |de/dtheta| at most.
    slope: DVector<f64>,
    absolute: DVector<f64>,
}

/// The same with the platform's constants integrated out.
#[derive(Debug, Clone, Default)]
pub(crate) struct Marginal {
    pub slope: Vec<f64>,
    pub pairs: Vec<f64>,
    /// Of each parameter by itself, and over how many readings it is spread at most.
    pub information: Vec<f64>,
    pub spread: Vec<f64>,
}

/// What is known of the platform's constants.
#[derive(Debug, Clone)]
pub(crate) struct Constants {
    sums: Sums,
    /// Those of which anything is known, and L^-1 of L L^T = A.
    known: Vec<usize>,
    inverse: DMatrix<f64>,
    /// L^-1 g, and the mean.
    half: DVector<f64>,
    mean: DVector<f64>,
}

/// Of a constant less is known than this share of its prior: it does not matter. Of a parameter the same, if it is ten times as large as
/// its prior says.
const NOTHING: f64 = 1e-3;
const NO_INFORMATION: f64 = 1e-5;

impl Sums {
    /// Of none, of a filter with so many states.
    pub fn none(states: usize, constants: usize, parameters: usize, pairs: usize) -> Self {
        Self {
            of_state: DMatrix::zeros(states, parameters),
            by_constants: DMatrix::zeros(constants, parameters),
            pairs: vec![0.0; pairs],
            slope: DVector::zeros(parameters),
            absolute: DVector::zeros(parameters),
        }
    }

    /// Adds a window; `constants` is X of the platform's constants at its beginning, `pairs` are those that it was asked for. All that was
    /// gathered before counts by a share.
    pub fn add(&mut self, window: &Window, constants: &DMatrix<f64>, pairs: &[(usize, usize)], share: f64) {
        let (x, (by_state, across)) = (&self.of_state, &window.by_state);
        let across = across.columns(0, x.ncols());
        let of_state = by_state * x;
        let through = &of_state + across;
        for (sum, ((a, b), new)) in self.pairs.iter_mut().zip(pairs.iter().zip(&window.pairs)) {
            let new = new + x.column(*a).dot(&through.column(*b)) + x.column(*b).dot(&across.column(*a));
            *sum = *sum * share + new;
        }
        self.by_constants.gemm(1.0, &constants.transpose(), &through, share);
        self.by_constants.gemm(1.0, &across.columns(0, constants.ncols()).transpose(), x, 1.0);
        self.by_constants += window.by_first.columns(0, x.ncols());
        self.slope *= share;
        self.slope += window.slope.1.rows(0, x.ncols());
        self.slope.gemv_tr(1.0, x, &window.slope.0, 1.0);
        for (k, sum) in self.absolute.iter_mut().enumerate() {
            // Cauchy and Schwarz's of what began before.
            let before = window.numbers as f64 * x.column(k).dot(&of_state.column(k)).max(0.0);
            *sum = *sum * share + window.absolute[k] + before.sqrt();
        }
        let mut of_state = window.moved.columns(0, x.ncols()).into_owned();
        of_state.gemm(1.0, &window.transition, x, 1.0);
        self.of_state = of_state;
    }

    /// The filter's state has been made anew in its first coordinates.
    pub fn forget_motion(&mut self, motion: usize) {
        self.of_state.rows_mut(0, motion).fill(0.0);
    }

    /// What they say with the platform's constants integrated out.
    pub fn without(&self, constants: &Constants, pairs: &[(usize, usize)]) -> Marginal {
        let mut marginal = Marginal {
            slope: self.slope.as_slice().to_vec(),
            pairs: self.pairs.clone(),
            information: vec![0.0; self.slope.len()],
            spread: vec![0.0; self.slope.len()],
        };
        // Of what nothing is known anyway the constants take nothing.
        let shows = pairs.iter().zip(&self.pairs).filter(|((a, b), sum)| a == b && **sum > NO_INFORMATION);
        let shown: Vec<usize> = shows.map(|((a, _), _)| *a).collect();
        let mut place = vec![None; self.slope.len()];
        shown.iter().enumerate().for_each(|(i, k)| place[*k] = Some(i));
        let rows = self.by_constants.select_columns(&shown).select_rows(&constants.known);
        let halves = &constants.inverse * rows;
        for (k, half) in shown.iter().zip(halves.column_iter()) {
            marginal.slope[*k] -= half.dot(&constants.half);
        }
        for (sum, (a, b)) in marginal.pairs.iter_mut().zip(pairs) {
            let whole = *sum;
            if let Some((i, j)) = place[*a].zip(place[*b]) {
                *sum -= halves.column(i).dot(&halves.column(j));
            }
            if a == b && whole > 0.0 {
                marginal.information[*a] = *sum;
                marginal.spread[*a] = self.absolute[*a].powi(2) / whole;
            }
        }
        marginal
    }
}

impl Constants {
    /// So many, of which nothing but their priors is known, of a filter with so many states.
    pub fn new(states: usize, constants: usize) -> Self {
        let sums = Sums::none(states, constants, constants, constants);
        let (half, mean) = (DVector::zeros(0), DVector::zeros(constants));
        Self { sums, known: Vec::new(), inverse: DMatrix::zeros(0, 0), half, mean }
    }

    /// Adds a window; all that was gathered before counts by a share.
    pub fn add(&mut self, window: &Window, share: f64) {
        let before = self.sums.of_state.clone();
        self.sums.add(window, &before, &[], share);
        self.sums.pairs = self.sums.by_constants.diagonal().iter().copied().collect();
        self.known = (0..self.mean.len()).filter(|k| self.sums.by_constants[(*k, *k)] > NOTHING).collect();
        let known = self.sums.by_constants.select_rows(&self.known).select_columns(&self.known);
        let mut inverse = DMatrix::identity(self.known.len(), self.known.len());
        // A sum of squares and one has a factor; without one nothing is known.
        let is_known = (known + &inverse).cholesky();
        if !is_known.is_some_and(|factor| factor.l_dirty().solve_lower_triangular_mut(&mut inverse)) {
            (self.known, inverse) = (Vec::new(), DMatrix::zeros(0, 0));
        }
        self.half = &inverse * self.sums.slope.select_rows(&self.known);
        let mean = inverse.tr_mul(&self.half);
        self.mean.fill(0.0);
        self.known.iter().zip(&mean).for_each(|(k, x)| self.mean[*k] = *x);
        self.inverse = inverse;
    }

    /// X, see [`Sums::add`].
    pub fn of_state(&self) -> &DMatrix<f64> {
        &self.sums.of_state
    }

    /// What speaks for each, alone, beside its prior: as if it were a parameter that began with the first window.
    pub fn alone(&self) -> Marginal {
        let pairs: Vec<(usize, usize)> = (0..self.mean.len()).map(|k| (k, k)).collect();
        self.sums.without(self, &pairs)
    }

    /// See [`Sums::forget_motion`].
    pub fn forget_motion(&mut self, motion: usize) {
        self.sums.forget_motion(motion);
    }

    /// What an innovation over its deviation is expected to be by them, and its variance beyond one; its changes with the filter's state at
    /// the window's beginning, and with constants that began with the window.
    pub fn expected(&self, by_state: &DVector<f64>, by_constant: &dyn Fn(usize) -> f64) -> (f64, f64) {
        let change = |k: &usize| by_constant(*k) + self.sums.of_state.column(*k).dot(by_state);
        let changes = DVector::from_iterator(self.known.len(), self.known.iter().map(change));
        let mean = self.known.iter().zip(&changes).map(|(k, change)| -change * self.mean[*k]).sum();
        (mean, (&self.inverse * changes).norm_squared())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use whorl_dynamics::{InitialState, Plant, PlatformModel};
    use whorl_prediction::{Difference, Disturbance, RandomTorque, Reading, Recursive};
    use whorl_recording::{Channel, Component};

    use super::*;

    const PAIRS: [(usize, usize); 4] = [(0, 0), (1, 1), (1, 2), (3, 3)];
    const CELLS: usize = 24;
    const STATES: usize = 3 + 3 + 3 + 3 + 3 + 3;

    /// Two constants and two effects, and readings that are off in any way, with these cells to a window. What is known of the constants and
    /// since a start at cell 12, and the innovations with how they change with the constants.
    fn gathered(cells: usize) -> (Constants, Sums, Sums) {
        let model = PlatformModel::whorl_1_reference();
        let start = InitialState { wheel_speed_rad_s: vec![40.0, -35.0, 30.0], ..InitialState::default() };
        let mut plant = Plant::new(&model, &start, 1).unwrap().without_random_torque();
        let slow = RandomTorque { stddev_b_n_m: [1e-3; 3], correlation_s: 20.0 };
        let disturbance =
            Disturbance { body: vec![slow], motors_n_m: vec![1e-3; 3], motors_correlation_s: 20.0 };
        let gyrostat = plant.gyrostat().clone();
        let mut filter = Recursive::new(&gyrostat, &plant, &disturbance, Default::default(), (2, 4), 2);
        assert_eq!(filter.layout().size(), STATES);
        for i in 3..9 {
            filter.set_variance(i, 1.0);
        }
        filter.layout().gyro_bias().for_each(|i| filter.set_variance(i, 1e-6));
        let mut constants = Constants::new(STATES, 2);
        let none = || Sums::none(STATES, 2, 4, PAIRS.len());
        let (mut first, mut later) = (none(), none());
        for cell in 0..CELLS {
            let along = |k: usize| ((cell * (k + 2)) as f64 * 0.3).sin();
            filter.rest();
            for k in 0..4 {
                let torque = Vector3::new(along(k), along(k + 1), 1.0) * 1e-2;
                let does = if k == 3 {
                    Difference::Gyro(torque)
                } else {
                    Difference::Torque(torque, [along(k) * 1e-3; 8])
                };
                filter.push(&plant, k, &does, 0.1);
            }
            let half_ns = 100_000_000;
            plant.advance_to(plant.now_ns() + 2 * half_ns).unwrap();
            filter.follow(&plant, half_ns);
            let reading = |r: usize| {
                let channel = if r < 3 { Channel::Gyro } else { Channel::WheelSpeed };
                let component = Component::new(channel, 0, r % 3);
                Reading { component, value: 0.01 * ((cell * 7 + r) as f64).cos(), variance: 1e-4 }
            };
            assert!(filter.take_in(&[0, 1, 2, 3, 4, 5].map(reading)));
            filter.follow(&plant, half_ns);
            filter.move_plant(&mut plant);
            if (cell + 1) % cells == 0 {
                let window = filter.window(&PAIRS);
                first.add(&window, constants.of_state(), &PAIRS, 1.0);
                if cell >= 12 {
                    later.add(&window, constants.of_state(), &PAIRS, 1.0);
                }
                constants.add(&window, 1.0);
            }
        }
        (constants, first, later)
    }

    /// In one window, of which the filter itself has the sums, or in several.
    #[test]
    fn windows_say_together_what_one_says() {
        let (whole, one, _) = gathered(CELLS);
        for cells in [2, 3, 12] {
            let (constants, first, _) = gathered(cells);
            let off = |a: &DMatrix<f64>, b: &DMatrix<f64>| (a - b).amax() / b.amax();
            assert!(off(&first.by_constants, &one.by_constants) < 1e-9);
            assert!(off(&first.of_state, &one.of_state) < 1e-9);
            assert!((&first.slope - &one.slope).amax() < 1e-9 * one.slope.amax());
            assert!((&constants.mean - &whole.mean).amax() < 1e-9 * whole.mean.amax());
            let largest = one.pairs.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            assert!(first.pairs.iter().zip(&one.pairs).all(|(a, b)| (a - b).abs() < 1e-9 * largest));
            // Sums of absolute values are bounds.
            let bound = first.absolute.iter().zip(&one.absolute);
            assert!(bound.clone().all(|(a, b)| *a > b * (1.0 - 1e-9)), "{:?}", bound.collect::<Vec<_>>());
        }
        // A start later than the first: the same with any windows.
        let (later, same) = (gathered(3).2, gathered(12).2);
        assert!((&later.slope - &same.slope).amax() < 1e-9 * same.slope.amax());
        assert!((&later.by_constants - &same.by_constants).amax() < 1e-9 * same.by_constants.amax());
    }

    /// The posterior of the constants, and an effect's likelihood with them integrated out: against all three as one regression.
    #[test]
    fn constants_are_integrated_out_over_their_priors() {
        let (constants, sums, _) = gathered(4);
        let marginal = sums.without(&constants, &PAIRS);
        // G of both constants and the third parameter, with the constants' priors.
        let g =
            |i: usize, k: usize| if i < 2 { sums.by_constants[(i, k)] } else { sums.by_constants[(k, i)] };
        let all = DMatrix::from_fn(2, 2, |i, k| g(i, k) + f64::from(u8::from(i == k)));
        let cross = DVector::from_fn(2, |i, _| sums.by_constants[(i, 3)]);
        let slope = DVector::from_fn(2, |i, _| sums.slope[i]);
        let mean = all.clone().lu().solve(&slope).unwrap();
        assert!((&mean - &constants.mean).amax() < 1e-9 * mean.amax());
        let expected = sums.pairs[3] - cross.dot(&all.clone().lu().solve(&cross).unwrap());
        assert!((marginal.pairs[3] - expected).abs() < 1e-9 * sums.pairs[3]);
        let expected = sums.slope[3] - cross.dot(&mean);
        assert!((marginal.slope[3] - expected).abs() < 1e-9 * sums.slope[3].abs());
    }
}
