//! How log p of a run changes with its levels of noise: exact gradients, and their information, half the inner products by V^-1 of the series
//! dV V^-1 y (METHOD.md, "Levels").

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::plant::ROTATION;
use whorl_math::lanes::{Gain, Gram, Lanes, Own, Sparse, dot, level};
use whorl_recording::{Channel, Component};

use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::trail::Trail;

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
    pub fn of(trail: &Trail, levels: &[Level], noise: &Noise) -> Self {
        let mut scores = Self::none(levels.len());
        let driven = Driven::all(trail, levels, noise);
        let (gradients, own) = scores.go_back(trail, &driven);
        // Every component that is read has a level.
        let level =
            |of: &Component| levels.iter().position(|one| *one == Level::of_reading(*of)).unwrap_or(0);
        let read: Vec<usize> = trail.components.iter().map(level).collect();
        for ((level, variance), own) in read.iter().zip(&trail.own).zip(&own) {
            scores.see(*level, *variance, own.value, own.expected);
        }
        scores.information = forth(trail, levels.len(), &driven, &read, gradients, &own);
        scores
    }

    /// A gradient by a noise of this variance, and the variance of the gradient.
    fn see(&mut self, level: usize, variance: f64, gradient: f64, expected: f64) {
        self.squares[level] += 0.5 * variance * gradient * gradient;
        self.expected[level] += 0.5 * variance * expected;
    }

    /// Gradients by what is driven, of these variances, which are kept for the way forth.
    fn see_driven(
        &mut self,
        driven: &[Driven],
        variance: impl Fn(&Driven) -> f64,
        (g, n): (&[f64], &Lanes),
        gradients: &mut Vec<f64>,
    ) {
        for of in driven {
            self.see(of.level, variance(of), g[of.coordinate], n.row(of.coordinate)[of.coordinate]);
            gradients.push(g[of.coordinate]);
        }
    }

    /// Goes back along the way: gradients by what is driven behind and before each stride, from the last one on, and at the start; and what all readings
    /// say of the error of each.
    fn go_back(&mut self, trail: &Trail, driven: &[Driven]) -> (Vec<f64>, Vec<Own>) {
        let size = trail.layout.size();
        let mut gradients = Vec::with_capacity(driven.len() * (2 * trail.strides.len() + 1));
        let mut own: Vec<Own> =
            trail.values.iter().map(|value| Own { value: *value, expected: 0.0 }).collect();
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
            n.take_out(&rows, &gain, &mut g, &mut own[due]);
            for i in (0..size).filter(|i| instant.held >> i & 1 == 1) {
                n.hold(i);
                g[i] = 0.0;
            }
            for stride in trail.strides[strides..instant.strides].iter().rev() {
                // By the trapezoidal rule: strides are short against whatever moves.
                let half = |of: &Driven| 0.5 * stride.step_s * of.density;
                if let Some(axis) = stride.unseen_axis {
                    n.level_covariance(&axis);
                    level(&mut g[ROTATION], &axis);
                }
                self.see_driven(driven, half, (&g, &n), &mut gradients);
                trail.transitions.rows_to(trail.transition(*stride), &mut transition);
                transposed.transpose(&transition);
                n.grow(&transposed, None);
                for (to, row) in moved.iter_mut().zip(transposed.rows()) {
                    *to = dot(row, &g);
                }
                g.iter_mut().zip(&moved).take(transposed.count()).for_each(|(g, by)| *g += by);
                self.see_driven(driven, half, (&g, &n), &mut gradients);
            }
        }
        self.see_driven(driven, |of| of.at_start, (&g, &n), &mut gradients);
        (gradients, own)
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
    fn all(trail: &Trail, levels: &[Level], noise: &Noise) -> Vec<Self> {
        let (layout, disturbance) = (trail.layout, &noise.disturbance);
        let body = layout.disturbance().len();
        let level = |k: usize| match k.checked_sub(body) {
            Some(motor) => Level::Motor(motor),
            None => Level::Body { process: k / 3, axis: k % 3 },
        };
        let all = disturbance.coordinates(layout).enumerate();
        let all = all.filter_map(|(k, (coordinate, stddev, correlation_s))| {
            let (level, variance) = (levels.iter().position(|one| *one == level(k))?, stddev * stddev);
            let at_start = if trail.is_first { variance } else { 0.0 };
            Some(Self { coordinate, level, density: 2.0 * variance / correlation_s, at_start })
        });
        all.collect()
    }
}

/// Innovations of the series q = dV V^-1 y of each level, and half their products. The estimate's own sensitivity is the negative of what a
/// level adds to the state.
fn forth(
    trail: &Trail,
    levels: usize,
    driven: &[Driven],
    read: &[usize],
    mut gradients: Vec<f64>,
    own: &[Own],
) -> DMatrix<f64> {
    let size = trail.layout.size();
    let (mut x, mut d) = (Lanes::zeros(size, levels), Lanes::zeros(0, levels));
    let mut information = Gram::new(levels, 0, 0);
    let (mut rows, mut transition) = (Sparse::default(), Sparse::default());
    let (mut gain, mut at) = (Gain::default(), [0; 3]);
    // The last that was kept on the way back is the first here.
    let mut drive = |x: &mut Lanes, variance: &dyn Fn(&Driven) -> f64| {
        for of in driven.iter().rev() {
            x.row_mut(of.coordinate)[of.level] -= variance(of) * gradients.pop().unwrap_or_default();
        }
    };
    drive(&mut x, &|of| of.at_start);
    for (k, instant) in trail.instants.iter().enumerate() {
        let (strides, readings) = trail.before(k);
        for stride in &trail.strides[strides..instant.strides] {
            let half = |of: &Driven| 0.5 * stride.step_s * of.density;
            drive(&mut x, &half);
            trail.transitions.rows_to(trail.transition(*stride), &mut transition);
            x.carry(&transition);
            drive(&mut x, &half);
            if let Some(axis) = stride.unseen_axis {
                x.level(&axis);
            }
        }
        (0..size).filter(|i| instant.held >> i & 1 == 1).for_each(|i| x.hold_row(i));
        let due = readings..instant.readings;
        trail.by_state.rows_to(due.clone(), &mut rows);
        gain.take_from(size, due.len(), [&trail.gains, &trail.couplings], &trail.variances, &mut at);
        d.clear(due.len());
        for (r, k) in due.enumerate() {
            d.row_mut(r)[read[k]] = trail.own[k] * own[k].value;
        }
        x.take_in(&rows, &gain, &mut d);
        for (r, variance) in gain.variances.iter().enumerate() {
            let scale = 1.0 / variance.sqrt();
            let next = information.room();
            next.iter_mut().zip(d.row(r)).for_each(|(to, d)| *to = d * scale);
            information.added();
        }
    }
    information.sum() * 0.5
}

/// A standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Level {
    /// Of a random torque on the body, about one of its axes [N m].
    Body { process: usize, axis: usize },
    /// Of a motor's random torque [N m].
    Motor(usize),
    /// Of a reading, in its channel's unit; of components that share it the first.
    Reading(Component),
}

impl Level {
    /// All that are not zero: torques first, in the order of a state's coordinates, then readings.
    pub fn all(case: &Prepared<'_>, noise: &Noise) -> Vec<Self> {
        let disturbance = &noise.disturbance;
        let body = (0..disturbance.body.len())
            .flat_map(|process| (0..3).map(move |axis| Self::Body { process, axis }))
            .chain((0..disturbance.motors_n_m.len()).map(Self::Motor));
        let mut list: Vec<Self> = body.filter(|level| level.stddev(noise) > 0.0).collect();
        for level in case.components().map(Self::of_reading) {
            if !list.contains(&level) {
                list.push(level);
            }
        }
        list
    }

    /// That of a reading: the axes across a direction share one, and all tachometers.
    pub fn of_reading(component: Component) -> Self {
        Self::Reading(match component.channel {
            Channel::Vector | Channel::WheelSpeed => Component::new(component.channel, component.sensor(), 0),
            _ => component,
        })
    }

    pub fn is_torque(self) -> bool {
        !matches!(self, Self::Reading(_))
    }

    pub fn stddev(self, noise: &Noise) -> f64 {
        let of = &noise.disturbance;
        match self {
            Self::Body { process, axis } => of.body[process].stddev_b_n_m[axis],
            Self::Motor(motor) => of.motors_n_m[motor],
            Self::Reading(component) => noise.of(component),
        }
    }

    pub fn set(self, noise: &mut Noise, stddev: f64) {
        let of = &mut noise.disturbance;
        match self {
            Self::Body { process, axis } => of.body[process].stddev_b_n_m[axis] = stddev,
            Self::Motor(motor) => of.motors_n_m[motor] = stddev,
            Self::Reading(component) => noise.set(component, stddev),
        }
    }
}
