//! How log p of a run changes with its levels of noise: exact gradients, and their information.
//!
//! With g the gradient of log p by the state behind a step and N its variance, both by going back along a filter's way, noise of
//! covariance Q that enters there has the gradient (g^T dQ g - tr(N dQ))/2: S. J. Koopman and N. Shephard, "Exact score for time series
//! models in state space form", *Biometrika* 79 (1992) 823. Its information is that of the series q = dV V^-1 y, whose
//! inner products by V^-1 are innovations' through the same gains: A. R. Gilmour, R. Thompson and B. R. Cullis, "Average information
//! REML", *Biometrics* 51 (1995) 1440.

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::plant::ROTATION;

use super::list::{Level, Levels};
use super::trail::Trail;
use crate::information::Information;
use crate::lanes::{Gain, Lanes, Own, Sparse, dot, level};
use crate::noise::Noise;

/// What a run says of its levels, by the logarithm of each variance.
pub(super) struct Scores {
    /// Half the squares of what readings say of each noise, in its own variance,
    pub squares: DVector<f64>,
    /// and what these are with these levels on average: d log p = squares - expected.
    pub expected: DVector<f64>,
    /// Average information.
    pub information: DMatrix<f64>,
}

impl Scores {
    /// Of nothing yet.
    pub fn none(levels: usize) -> Self {
        Self {
            squares: DVector::zeros(levels),
            expected: DVector::zeros(levels),
            information: DMatrix::zeros(levels, levels),
        }
    }

    /// With what another block says.
    pub fn add(&mut self, other: &Self) {
        self.squares += &other.squares;
        self.expected += &other.expected;
        self.information += &other.information;
    }

    /// Of a block, at whose begin the state is known as well as the filter knows it.
    pub fn of(trail: &Trail, levels: &Levels, noise: &Noise) -> Self {
        let driven = Driven::all(trail, levels, noise);
        let back = Back::along(trail, &driven);
        let (mut squares, mut expected) = (DVector::zeros(levels.count()), DVector::zeros(levels.count()));
        for (k, of) in driven.iter().enumerate() {
            squares[of.level] +=
                0.5 * (of.density * back.squares[k] + of.at_start * back.at_start[k].powi(2));
            expected[of.level] +=
                0.5 * (of.density * back.variances[k] + of.at_start * back.start_variances[k]);
        }
        let read: Vec<Option<(usize, f64)>> = trail
            .components
            .iter()
            .zip(&trail.own)
            .map(|(component, variance)| Some((levels.of_reading(*component)?, *variance)))
            .collect();
        for ((level, variance), own) in read.iter().zip(&back.own).filter_map(|(to, own)| Some(((*to)?, own)))
        {
            squares[level] += 0.5 * variance * own.value * own.value;
            expected[level] += 0.5 * variance * own.expected;
        }
        let information = forth(trail, levels.count(), &driven, &read, &back);
        Self { squares, expected, information }
    }

    /// By how much each level makes a run likelier than none does, at the best that it could have beside the others.
    ///
    /// Let it drive n numbers alike that are otherwise as noisy as one: of variance w where 1 is expected without it, and 1/(1 - x) with it as it is. Then
    /// A = n w x (1 - x)/2, B = n x/2, and the information is x A; the best level makes the numbers likelier by n (w - 1 - ln w)/2.
    pub fn worth_nats(&self, i: usize) -> f64 {
        let (squares, expected) = (self.squares[i], self.expected[i]);
        let x = self.information[(i, i)] / squares;
        let w = squares / (expected * (1.0 - x));
        let is_shown = w > 1.0 && w.is_finite();
        if is_shown { expected / x * (w - 1.0 - w.ln()) } else { 0.0 }
    }
}

/// A coordinate that white noise drives.
struct Driven {
    coordinate: usize,
    level: usize,
    /// Variance that it gains in a second, and that it has at the start of the run.
    density: f64,
    at_start: f64,
}

impl Driven {
    fn all(trail: &Trail, levels: &Levels, noise: &Noise) -> Vec<Self> {
        let (layout, disturbance) = (trail.layout, &noise.disturbance);
        let body = layout.disturbance().len();
        let level = |k: usize| match k.checked_sub(body) {
            Some(motor) => Level::Motor(motor),
            None => Level::Body { process: k / 3, axis: k % 3 },
        };
        let times = disturbance.coordinates(layout).zip(disturbance.times(layout));
        let all = times.enumerate().filter_map(|(k, ((coordinate, stddev), (_, correlation_s)))| {
            let (level, variance) = (levels.position(level(k))?, stddev * stddev);
            let at_start = if trail.is_first { variance } else { 0.0 };
            Some(Self { coordinate, level, density: 2.0 * variance / correlation_s, at_start })
        });
        all.collect()
    }
}

/// What is found on the way back.
struct Back {
    /// Of each coordinate that is driven: the integral of the square of its gradient over time, and of the variance of this.
    squares: Vec<f64>,
    variances: Vec<f64>,
    /// The gradient at the start, and its variance.
    at_start: Vec<f64>,
    start_variances: Vec<f64>,
    /// The gradients before and behind each stride.
    before: Vec<f64>,
    behind: Vec<f64>,
    /// What all readings say of the error of each.
    own: Vec<Own>,
}

impl Back {
    fn along(trail: &Trail, driven: &[Driven]) -> Self {
        let (size, count) = (trail.layout.size(), driven.len());
        let none = vec![0.0; count];
        let of_strides = vec![0.0; count * trail.strides.len()];
        let mut back = Self {
            squares: none.clone(),
            variances: none.clone(),
            at_start: none.clone(),
            start_variances: none,
            before: of_strides.clone(),
            behind: of_strides,
            own: trail.values.iter().map(|value| Own { value: *value, expected: 0.0 }).collect(),
        };
        let (mut n, mut g) = (Lanes::zeros(size, size), vec![0.0; size]);
        let [mut rows, mut transition, mut transposed] = [(); 3].map(|()| Sparse::default());
        let (mut gain, mut moved) = (Gain::default(), vec![0.0; size]);
        let mut at = [trail.gains.len(), trail.couplings.len(), trail.variances.len()];
        for (k, instant) in trail.instants.iter().enumerate().rev() {
            let (strides, readings) = trail.before(k);
            let due = readings..instant.readings;
            for (at, length) in at.iter_mut().zip(Gain::lengths(size, due.len())) {
                *at -= length;
            }
            trail.by_state.rows_to(due.clone(), &mut rows);
            gain.take_from(size, due.len(), [&trail.gains, &trail.couplings], &trail.variances, &mut { at });
            n.take_out(&rows, &gain, &mut g, &mut back.own[due]);
            for i in (0..size).filter(|i| instant.held >> i & 1 == 1) {
                n.hold(i);
                g[i] = 0.0;
            }
            for s in (strides..instant.strides).rev() {
                let stride = trail.strides[s];
                if let Some(axis) = stride.unseen_axis {
                    n.level_covariance(&axis);
                    level(&mut g[ROTATION], &axis);
                }
                let places = s * count..(s + 1) * count;
                back.add(driven, stride.step_s, &n, &g);
                let gradients = || driven.iter().map(|of| of.coordinate);
                back.behind[places.clone()].iter_mut().zip(gradients()).for_each(|(to, i)| *to = g[i]);
                trail.transitions.rows_to(trail.transition(stride), &mut transition);
                transposed.transpose(&transition);
                n.grow(&transposed, None);
                for (to, row) in moved.iter_mut().zip(transposed.rows()) {
                    *to = dot(row, &g);
                }
                g.iter_mut().zip(&moved).take(transposed.count()).for_each(|(g, by)| *g += by);
                back.add(driven, stride.step_s, &n, &g);
                back.before[places].iter_mut().zip(gradients()).for_each(|(to, i)| *to = g[i]);
            }
        }
        for (k, of) in driven.iter().enumerate() {
            back.at_start[k] = g[of.coordinate];
            back.start_variances[k] = n.row(of.coordinate)[of.coordinate];
        }
        back
    }

    /// One end of a stride, by the trapezoidal rule: strides are short against whatever moves.
    fn add(&mut self, driven: &[Driven], step_s: f64, n: &Lanes, g: &[f64]) {
        for (k, of) in driven.iter().enumerate() {
            self.squares[k] += 0.5 * step_s * g[of.coordinate].powi(2);
            self.variances[k] += 0.5 * step_s * n.row(of.coordinate)[of.coordinate];
        }
    }
}

/// Innovations of the series q = dV V^-1 y of each level, and half their products. The estimate's own sensitivity is the negative of what a
/// level adds to the state.
fn forth(
    trail: &Trail,
    levels: usize,
    driven: &[Driven],
    read: &[Option<(usize, f64)>],
    back: &Back,
) -> DMatrix<f64> {
    let (size, count) = (trail.layout.size(), driven.len());
    let (mut x, mut d) = (Lanes::zeros(size, levels), Lanes::zeros(0, levels));
    let mut information = Information::new(levels, 0, 0);
    let (mut rows, mut transition) = (Sparse::default(), Sparse::default());
    let (mut gain, mut at) = (Gain::default(), [0; 3]);
    for (of, gradient) in driven.iter().zip(&back.at_start) {
        x.row_mut(of.coordinate)[of.level] -= of.at_start * gradient;
    }
    for (k, instant) in trail.instants.iter().enumerate() {
        let (strides, readings) = trail.before(k);
        for s in strides..instant.strides {
            let stride = trail.strides[s];
            let add = |x: &mut Lanes, gradients: &[f64]| {
                for (of, gradient) in driven.iter().zip(&gradients[s * count..]) {
                    x.row_mut(of.coordinate)[of.level] -= 0.5 * stride.step_s * of.density * gradient;
                }
            };
            add(&mut x, &back.before);
            trail.transitions.rows_to(trail.transition(stride), &mut transition);
            x.carry(&transition);
            add(&mut x, &back.behind);
            if let Some(axis) = stride.unseen_axis {
                x.level(&axis);
            }
        }
        (0..size).filter(|i| instant.held >> i & 1 == 1).for_each(|i| x.hold_row(i));
        let due = readings..instant.readings;
        trail.by_state.rows_to(due.clone(), &mut rows);
        gain.take_from(size, due.len(), [&trail.gains, &trail.couplings], &trail.variances, &mut at);
        d.clear(due.len());
        for (r, (to, own)) in read[due.clone()].iter().zip(&back.own[due]).enumerate() {
            if let Some((level, variance)) = to {
                d.row_mut(r)[*level] = variance * own.value;
            }
        }
        x.take_in(&rows, &gain, &mut d);
        for (r, variance) in gain.variances.iter().enumerate() {
            let scale = 1.0 / variance.sqrt();
            let next = information.next();
            next.iter_mut().zip(d.row(r)).for_each(|(to, d)| *to = d * scale);
            information.added();
        }
    }
    information.sum() * 0.5
}
