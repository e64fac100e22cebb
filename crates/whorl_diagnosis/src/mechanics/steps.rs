//! Steps within an interval, by which hidden states are carried on.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::Environment;
use whorl_dynamics::effects::MAX_HIDDEN_STATES;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::{quaternion_exp, vertical_b};

use crate::motion::Motion;
use crate::run::{Run, Wheels};

/// Longest step \[s\].
const LONGEST_S: f64 = 0.012;

/// Most steps in an interval.
const MOST: usize = 64;

/// The motion at one instant.
#[derive(Debug, Clone, Copy)]
struct Instant {
    time_s: f64,
    q_world_body: UnitQuaternion<f64>,
    vertical_b: Vector3<f64>,
    omega: Vector3<f64>,
    speed: Wheels,
}

/// The motion within one interval at the ends and middles of steps: the same for every model that is carried
/// along it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Steps {
    step_s: f64,
    /// The acceleration that was seen drives hidden states, not a model's own.
    seen: Vector3<f64>,
    instants: Vec<Instant>,
}

impl Steps {
    /// Lays out interval `k`; false if there is none.
    pub fn fill(&mut self, run: &Run, motion: &Motion, k: usize) -> bool {
        let (Some(q0), Some(w0), Some(w1), Some(s0), Some(s1)) = (
            motion.q.get(k),
            motion.omega.get(k),
            motion.omega.get(k + 1),
            motion.wheel.get(k),
            motion.wheel.get(k + 1),
        ) else {
            return false;
        };
        let length = run.length(k);
        self.seen = (w1 - w0) / length;
        let steps = ((length / LONGEST_S).ceil() as usize).clamp(1, MOST);
        self.step_s = length / steps as f64;
        self.instants.clear();
        for half_step in 0..=2 * steps {
            let share = half_step as f64 / (2 * steps) as f64;
            let mut speed = [0.0; MAX_WHEELS];
            for ((x, a), b) in speed.iter_mut().zip(s0).zip(s1) {
                *x = a + (b - a) * share;
            }
            let q = q0 * quaternion_exp(&(w0.lerp(w1, 0.5 * share) * (share * length)));
            self.instants.push(Instant {
                time_s: run.time(k) + share * length,
                q_world_body: q,
                vertical_b: vertical_b(&q),
                omega: w0.lerp(w1, share),
                speed,
            });
        }
        true
    }

    /// Steps in the interval.
    pub fn count(&self) -> usize {
        self.instants.len() / 2
    }

    /// What effects see at a half step; all that the motion does not say is as in `interval`.
    fn at<'a>(&'a self, half_step: usize, interval: &Environment<'a>) -> Environment<'a> {
        let Some(instant) = self.instants.get(half_step) else { return *interval };
        Environment {
            time_s: instant.time_s,
            q_world_body: instant.q_world_body,
            vertical_b: instant.vertical_b,
            omega_wb_b_rad_s: instant.omega,
            wheel_speed_rad_s: instant.speed.get(..interval.wheel_speed_rad_s.len()).unwrap_or(&[]),
            ..*interval
        }
    }

    /// What effects see in the middle of a step.
    pub fn middle_of<'a>(&'a self, step: usize, interval: &Environment<'a>) -> Environment<'a> {
        self.at(2 * step + 1, interval)
    }

    /// Carries hidden states over a step by a Runge-Kutta step and returns those in its middle.
    pub fn advance(
        &self,
        step: usize,
        interval: &Environment<'_>,
        hidden: &mut [f64],
        derivative: impl Fn(&Environment<'_>, &[f64], &mut [f64]),
    ) -> [f64; MAX_HIDDEN_STATES] {
        let n = hidden.len().min(MAX_HIDDEN_STATES);
        let [start, middle, end] = [0, 1, 2]
            .map(|i| Environment { omega_dot_wb_b_rad_s2: self.seen, ..self.at(2 * step + i, interval) });
        let rate = |environment: &Environment<'_>, x: &[f64]| {
            let mut rate = [0.0; MAX_HIDDEN_STATES];
            derivative(environment, &x[..n], &mut rate[..n]);
            rate
        };
        let moved = |x: &[f64], rate: &[f64], dt: f64| {
            let mut y = [0.0; MAX_HIDDEN_STATES];
            for ((slot, a), r) in y.iter_mut().zip(x).zip(rate) {
                *slot = a + r * dt;
            }
            y
        };
        let h = self.step_s;
        let k1 = rate(&start, hidden);
        let k2 = rate(&middle, &moved(hidden, &k1, 0.5 * h));
        let half = moved(hidden, &k2, 0.5 * h);
        let k3 = rate(&middle, &half);
        let k4 = rate(&end, &moved(hidden, &k3, h));
        for (i, x) in hidden.iter_mut().take(n).enumerate() {
            *x += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
        half
    }
}
