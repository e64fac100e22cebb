//! The Kalman filter that whitens a run, and the smoother that improves its trajectory.
//!
//! State: small errors of the trajectory, in this order: attitude (3, body axes), rate (3), gyro bias (3),
//! accelerometer bias (3), wheel speeds, if asked for an unmodelled torque (3), and hidden states of effects that may be
//! anywhere at the start. The filter is linear,
//! so the innovation depends linearly on every parameter, and its sensitivities pass through the same
//! gains (Ljung 1999, section 10.3; Klein and Morelli 2006, filter error method).

mod dynamics;
mod hidden;
mod linear;
mod measurement;
mod noise;
mod smoother;
mod square;

use nalgebra::Vector3;
use whorl_recording::Component;

use crate::bins::motion::Motion;
use crate::bins::run::Run;
use crate::whitening::mechanics::{Mechanics, Prediction};

pub(crate) use linear::Linear;

use square::{Square, congruence, symmetrise};

/// First index of each part of the state.
pub(crate) const ANGLE: usize = 0;
pub(crate) const RATE: usize = 3;
pub(crate) const GYRO_BIAS: usize = 6;
pub(crate) const ACCEL_BIAS: usize = 9;
pub(crate) const WHEEL: usize = 12;

/// Room for all states: of eight wheels, a torque and hidden states of two effects.
pub(crate) const MOST_STATES: usize = 32;

/// An unmodelled slow random torque: a first-order Markov process (an Ornstein-Uhlenbeck process; Gelb 1974,
/// section 3.8).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Background {
    /// Standard deviation [N m]; 0 = there is none.
    pub stddev_n_m: f64,
    /// Time over which it forgets itself \[s\].
    pub correlation_s: f64,
}

/// How the filter is set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settings {
    /// Random-walk intensity of the rate, the torque that the model lacks without memory [rad/s/sqrt(s)].
    pub rate_walk: f64,
    /// Intensity of a random-walk torque state [N m/sqrt(s)]; 0 = no such state.
    pub torque_walk: f64,
    /// A slow random torque.
    pub background: Background,
    /// Torque noise of the wheels [N m sqrt(s)].
    pub wheel_noise: f64,
    /// Least random walk of the gyro's bias [rad/s/sqrt(s)].
    pub gyro_bias_walk: f64,
    /// A body that turns slower may stand still, held by dry friction [rad/s],
    pub stands_rad_s: f64,
    /// and a wheel [rad/s].
    pub wheel_stands_rad_s: f64,
    /// Time over which dry friction at standstill changes its pull \[s\].
    pub sticks_s: f64,
}

impl Settings {
    /// Whether the state holds a torque.
    pub fn has_torque(&self) -> bool {
        self.torque_walk > 0.0 || self.background.stddev_n_m > 0.0
    }

    /// Rate at which the torque of the state decays [1/s]: a walk does not.
    fn torque_decay_per_s(&self) -> f64 {
        let is_walk = self.torque_walk > 0.0 || self.background.correlation_s <= 0.0;
        if is_walk { 0.0 } else { 1.0 / self.background.correlation_s }
    }

    /// Variance that the torque of the state about an axis gains in a second [N^2 m^2/s].
    fn torque_intensity(&self) -> f64 {
        let background = &self.background;
        let of_background = 2.0 * background.stddev_n_m.powi(2) / background.correlation_s.max(1e-3);
        self.torque_walk.powi(2) + of_background
    }
}

/// The filter's gains along a run: all that columns need to pass through it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gains {
    pub linear: Linear,
    /// 1 / standard deviation of each innovation.
    pub inverse_stddev: Vec<f64>,
    /// rows x n
    pub gain: Vec<f64>,
    /// Whitened residual.
    pub whitened: Vec<f64>,
}

impl Gains {
    /// What each row reads.
    pub fn readings(&self) -> Vec<Component> {
        self.linear.rows().iter().map(|row| row.reading).collect()
    }

    /// Node of each row.
    pub fn nodes(&self) -> Vec<u32> {
        self.linear.rows().iter().map(|row| row.node).collect()
    }
}

/// Two axes across a direction.
pub(crate) fn across(direction: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = if direction.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
    let e1 = direction.cross(&helper);
    let e1 = e1 / e1.norm().max(1e-12);
    (e1, direction.cross(&e1))
}

/// Linearised system of one run.
#[derive(Clone, Copy)]
pub(crate) struct System<'a> {
    pub run: &'a Run,
    pub motion: &'a Motion,
    pub mechanics: &'a Mechanics,
    pub prediction: &'a Prediction,
    pub settings: Settings,
}

/// What is kept of a run of the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keep {
    Innovations,
    Gains,
    /// What the smoother needs.
    Predictions,
}

/// A run of the filter.
#[derive(Default)]
pub(crate) struct Forward {
    log_likelihood: f64,
    whitened: Vec<f64>,
    inverse_stddev: Vec<f64>,
    /// rows x n
    gain: Vec<f64>,
    /// Predicted states, nodes x n, and their covariance, nodes x n x n.
    state: Vec<f64>,
    covariance: Vec<f64>,
}

/// A run of the filter with room for `S` states, compiled for each kind of processor that pulp knows.
struct WithRoom<'a, const S: usize> {
    system: &'a System<'a>,
    linear: &'a Linear,
    keep: Keep,
}

impl<const S: usize> pulp::NullaryFnOnce for WithRoom<'_, S> {
    type Output = Forward;

    #[inline(always)]
    fn call(self) -> Forward {
        self.system.forward_sized::<S>(self.linear, self.keep)
    }
}

impl System<'_> {
    pub fn wheels(&self) -> usize {
        self.mechanics.model().wheels().len()
    }

    pub fn states(&self) -> usize {
        self.first_hidden() + self.hidden_states()
    }

    /// First index of the hidden states.
    fn first_hidden(&self) -> usize {
        WHEEL + self.wheels() + if self.settings.has_torque() { 3 } else { 0 }
    }

    /// Whitened innovations, and the log density of the measurements where all of them are zero.
    pub fn innovations(&self, linear: &Linear) -> (Vec<f64>, f64) {
        let forward = self.forward(linear, Keep::Innovations);
        let log_density = forward.inverse_stddev.iter().map(|s| s.ln()).sum();
        (forward.whitened, log_density)
    }

    /// Log likelihood of the measurements.
    pub fn log_likelihood(&self, linear: &Linear) -> f64 {
        self.forward(linear, Keep::Innovations).log_likelihood
    }

    /// A run of the filter from which the smoother can go back.
    pub fn filtered(&self, linear: &Linear) -> Forward {
        self.forward(linear, Keep::Predictions)
    }

    /// Gains and whitened residuals.
    pub fn gains(&self, linear: Linear) -> Gains {
        let Forward { whitened, inverse_stddev, gain, .. } = self.forward(&linear, Keep::Gains);
        Gains { linear, inverse_stddev, gain, whitened }
    }

    fn forward(&self, linear: &Linear, keep: Keep) -> Forward {
        // Few sizes of matrices, each a multiple of what processors handle at once.
        let processor = pulp::Arch::new();
        match linear.n {
            0..=16 => processor.dispatch(WithRoom::<16> { system: self, linear, keep }),
            17..=20 => processor.dispatch(WithRoom::<20> { system: self, linear, keep }),
            21..=24 => processor.dispatch(WithRoom::<24> { system: self, linear, keep }),
            _ => processor.dispatch(WithRoom::<MOST_STATES> { system: self, linear, keep }),
        }
    }

    #[inline(always)]
    fn forward_sized<const S: usize>(&self, linear: &Linear, keep: Keep) -> Forward {
        let n = linear.n.min(S);
        let nodes = self.run.nodes();
        let noise = self.noise();
        let rows = linear.rows().len();
        let room = |size: usize, kept: bool| Vec::with_capacity(if kept { size } else { 0 });
        let mut forward = Forward {
            whitened: room(rows, true),
            inverse_stddev: room(rows, true),
            gain: room(rows * n, keep != Keep::Innovations),
            state: room(nodes * n, keep == Keep::Predictions),
            covariance: room(nodes * n * n, keep == Keep::Predictions),
            ..Forward::default()
        };
        let mut p: Square<S> = self.initial_covariance();
        let mut x: [f64; S] = self.initial_state();
        for k in 0..nodes {
            if keep == Keep::Predictions {
                forward.state.extend_from_slice(&x[..n]);
                p.iter().take(n).for_each(|row| forward.covariance.extend_from_slice(&row[..n]));
            }
            for row in &linear.rows()[linear.rows_of(k)] {
                // P h^T is a sum of few rows of P.
                let mut ph = [0.0; S];
                let mut innovation = row.residual;
                for (i, h) in row.parts() {
                    ph.iter_mut().zip(&p[i]).for_each(|(slot, c)| *slot += h * c);
                    innovation -= h * x[i];
                }
                let s = row.variance + row.parts().map(|(i, h)| h * ph[i]).sum::<f64>();
                let gain = ph.map(|c| c / s);
                for ((state, covariance), g) in x.iter_mut().zip(&mut p).zip(&gain).take(n) {
                    *state += g * innovation;
                    covariance.iter_mut().zip(&ph).for_each(|(slot, c)| *slot -= g * c);
                }
                forward.log_likelihood -= 0.5 * (innovation * innovation / s + s.ln());
                let inverse = 1.0 / s.sqrt();
                forward.whitened.push(innovation * inverse);
                forward.inverse_stddev.push(inverse);
                if keep != Keep::Innovations {
                    forward.gain.extend_from_slice(&gain[..n]);
                }
            }
            if k + 1 < nodes {
                let mut moved = [0.0; S];
                let defect = linear.defect.iter().skip(k * n);
                for ((slot, (columns, row)), d) in moved.iter_mut().zip(linear.transition_over(k)).zip(defect)
                {
                    *slot = d + columns.iter().zip(row).map(|(m, f)| f * x[*m]).sum::<f64>();
                }
                x = moved;
                p = congruence(|| linear.transition_over(k), &p);
                self.add_noise(&noise, k, &mut p);
                symmetrise(&mut p);
            }
        }
        forward
    }
}
