//! How log p of a run changes with its levels of noise: exact gradients, and their information, half the inner products by V^-1 of the series
//! dV V^-1 y (METHOD.md, "Levels").

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::plant::ROTATION;
use whorl_math::lanes::{Lanes, Own, Sparse, dot, level};
use whorl_recording::{Channel, Component};

use crate::blocks::Blocks;
use crate::trail::Trail;
use crate::{Noise, Prepared};

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
    pub fn none(levels: usize) -> Self {
        let none = DVector::zeros(levels);
        Self { squares: none.clone(), expected: none, information: DMatrix::zeros(levels, levels) }
    }

    /// With what a block says, at whose begin the state is known as well as the filter knows it.
    pub fn add(&mut self, trail: &Trail, levels: &[Level], noise: &Noise) {
        let driven = Driven::all(trail, levels, noise);
        let (gradients, own) = self.go_back(trail, &driven);
        // Every component that is read has a level.
        let level =
            |of: &Component| levels.iter().position(|one| *one == Level::of_reading(*of)).unwrap_or(0);
        let all = || trail.instants.iter();
        let read: Vec<usize> = all().flat_map(|instant| &instant.components).map(level).collect();
        let variances = all().flat_map(|instant| &instant.own);
        for ((level, variance), own) in read.iter().zip(variances).zip(&own) {
            self.see(*level, *variance, own.value, own.expected);
        }
        self.information += forth(trail, levels.len(), &driven, &read, gradients, &own);
    }

    /// A gradient by a noise of this variance, and the variance of the gradient.
    fn see(&mut self, level: usize, variance: f64, gradient: f64, expected: f64) {
        self.squares[level] += 0.5 * variance * gradient * gradient;
        self.expected[level] += 0.5 * variance * expected;
    }

    /// Goes back along the way: gradients by what is driven behind and before each stride, from the last on, and at the start; and what readings say of each error.
    fn go_back(&mut self, trail: &Trail, driven: &[Driven]) -> (Vec<f64>, Vec<Own>) {
        let size = trail.layout.size();
        let mut gradients = Vec::new();
        let values = trail.instants.iter().flat_map(|instant| &instant.values);
        let mut own: Vec<Own> = values.map(|value| Own { value: *value, expected: 0.0 }).collect();
        let (mut n, mut g) = (Lanes::zeros(size, size), vec![0.0; size]);
        let (mut transposed, mut moved) = (Sparse::default(), vec![0.0; size]);
        let mut end = own.len();
        let mut see = |step_s: Option<f64>, g: &[f64], n: &Lanes| {
            for of in driven {
                let (gradient, expected) = (g[of.coordinate], n.row(of.coordinate)[of.coordinate]);
                self.see(of.level, of.variance(step_s), gradient, expected);
                gradients.push(gradient);
            }
        };
        for instant in trail.instants.iter().rev() {
            let begin = end - instant.values.len();
            n.take_out(&instant.by_state, &instant.gain, &mut g, &mut own[begin..end]);
            end = begin;
            for i in &instant.held {
                n.hold(*i);
                g[*i] = 0.0;
            }
            for stride in instant.strides.iter().rev() {
                // By the trapezoidal rule: strides are short against whatever moves.
                let half_s = Some(0.5 * stride.step_s);
                if let Some(axis) = stride.unseen_axis {
                    n.level_covariance(&axis);
                    level(&mut g[ROTATION], &axis);
                }
                see(half_s, &g, &n);
                transposed.transpose(&stride.transition);
                n.grow(&transposed, None);
                for (to, row) in moved.iter_mut().zip(transposed.rows()) {
                    *to = dot(row, &g);
                }
                g.iter_mut().zip(&moved).take(transposed.count()).for_each(|(g, by)| *g += by);
                see(half_s, &g, &n);
            }
        }
        see(None, &g, &n);
        (gradients, own)
    }

    /// By how much each level makes a run likelier than none does, at the best that it could have beside the others.
    /// Let it drive n numbers alike that are otherwise as noisy as one: of variance w where 1 is expected without it, and 1/(1 - x) with it as it is. Then
    /// A = n w x (1 - x)/2, B = n x/2, and the information is x A; the best level makes the numbers likelier by n (w - 1 - ln w)/2.
    pub fn worth_nats(&self, i: usize) -> f64 {
        let (squares, expected) = (self.squares[i], self.expected[i]);
        let x = self.information[(i, i)] / squares;
        let w = squares / (expected * (1.0 - x));
        if w > 1.0 && w.is_finite() { expected / x * (w - 1.0 - w.ln()) } else { 0.0 }
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
    /// Variance that it gains over a time \[s\]; without one, that of the start.
    fn variance(&self, over_s: Option<f64>) -> f64 {
        over_s.map_or(self.at_start, |over_s| over_s * self.density)
    }

    fn all(trail: &Trail, levels: &[Level], noise: &Noise) -> Vec<Self> {
        let (layout, disturbance) = (trail.layout, &noise.disturbance);
        let all = disturbance.coordinates(layout).filter_map(|(coordinate, stddev, correlation_s)| {
            // On a bench there are no states of the body's.
            let motor = coordinate.checked_sub(layout.motors().start).map(|k| 3 * disturbance.body.len() + k);
            let torque = Level::Torque(motor.unwrap_or_else(|| coordinate - layout.disturbance().start));
            let level = levels.iter().position(|one| *one == torque)?;
            let variance = stddev * stddev;
            let at_start = if trail.is_first { variance } else { 0.0 };
            Some(Self { coordinate, level, density: 2.0 * variance / correlation_s, at_start })
        });
        all.collect()
    }
}

/// Half the products of the innovations of the series q = dV V^-1 y of each level, which adds to the state minus the estimate's own sensitivity.
fn forth(
    trail: &Trail,
    levels: usize,
    driven: &[Driven],
    read: &[usize],
    mut gradients: Vec<f64>,
    own: &[Own],
) -> DMatrix<f64> {
    let mut blocks = Blocks::new(trail.layout, false, levels, 0, 0);
    // The last that was kept on the way back is the first here.
    let mut drive = |blocks: &mut Blocks, over_s| {
        for of in driven.iter().rev() {
            *blocks.at_mut(of.coordinate, of.level) -=
                of.variance(over_s) * gradients.pop().unwrap_or_default();
        }
    };
    drive(&mut blocks, None);
    let mut read = read.iter().zip(own);
    for instant in &trail.instants {
        for stride in &instant.strides {
            drive(&mut blocks, Some(0.5 * stride.step_s));
            blocks.carry(&stride.transition, stride.step_s);
            drive(&mut blocks, Some(0.5 * stride.step_s));
            stride.unseen_axis.iter().for_each(|axis| blocks.level(axis));
        }
        instant.held.iter().for_each(|i| blocks.hold(*i));
        blocks.clear_readings(instant.values.len());
        for (r, (variance, (level, own))) in instant.own.iter().zip(read.by_ref()).enumerate() {
            *blocks.reading(r, *level) = variance * own.value;
        }
        blocks.take_in(&instant.by_state, &instant.gain, &instant.values);
    }
    blocks.said().0 * 0.5
}

/// A standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Level {
    /// Of a random torque, by its position among those of the disturbance [N m].
    Torque(usize),
    /// Of a reading, in its channel's unit; of components that share it the first.
    Reading(Component),
}

impl Level {
    /// All that are not zero: torques first, in the order of a state's coordinates, then readings.
    pub fn all(case: &Prepared<'_>, noise: &Noise) -> Vec<Self> {
        let torques = noise.disturbance.stddevs_n_m().enumerate().filter(|(_, stddev)| *stddev > 0.0);
        let mut list: Vec<Self> = torques.map(|(k, _)| Self::Torque(k)).collect();
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
        matches!(self, Self::Torque(_))
    }

    pub fn stddev(self, noise: &Noise) -> f64 {
        match self {
            Self::Torque(k) => noise.disturbance.stddevs_n_m().nth(k).unwrap_or_default(),
            Self::Reading(component) => noise.of(component),
        }
    }

    pub fn set(self, noise: &mut Noise, stddev: f64) {
        let slot = match self {
            Self::Torque(k) => noise.disturbance.stddevs_n_m_mut().nth(k),
            Self::Reading(component) => noise.slot(component),
        };
        slot.into_iter().for_each(|slot| *slot = stddev);
    }
}
