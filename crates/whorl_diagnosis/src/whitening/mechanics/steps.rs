//! Steps within an interval, by which hidden states are carried on.

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};
use whorl_dynamics::Environment;
use whorl_dynamics::effects::MAX_HIDDEN_STATES;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::{quaternion_exp, vertical_b};

use crate::bins::motion::Motion;
use crate::bins::run::{Run, Wheels};

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
    /// The interval is the run's first.
    begins: bool,
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
        self.begins = k == 0;
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

    /// What effects see in this interval; all that the motion does not say is as in `interval`.
    pub fn environments<'a>(&'a self, interval: &Environment<'a>) -> StepEnvironments<'a> {
        let at = |instant: &'a Instant| Environment {
            time_s: instant.time_s,
            q_world_body: instant.q_world_body,
            vertical_b: instant.vertical_b,
            omega_wb_b_rad_s: instant.omega,
            wheel_speed_rad_s: instant.speed.get(..interval.wheel_speed_rad_s.len()).unwrap_or(&[]),
            ..*interval
        };
        StepEnvironments {
            step_s: self.step_s,
            begins: self.begins,
            middle: self.instants.iter().skip(1).step_by(2).map(at).collect(),
            moving: self
                .instants
                .iter()
                .map(|instant| Environment { omega_dot_wb_b_rad_s2: self.seen, ..at(instant) })
                .collect(),
        }
    }
}

/// What effects see in the steps of an interval.
#[derive(Debug, Clone, Default)]
pub(crate) struct StepEnvironments<'a> {
    step_s: f64,
    /// The interval is the run's first.
    begins: bool,
    /// In the middle of each step, for torques.
    middle: Vec<Environment<'a>>,
    /// At every half step, the acceleration included, for hidden states.
    moving: Vec<Environment<'a>>,
}

impl StepEnvironments<'_> {
    /// Steps in the interval.
    pub fn count(&self) -> usize {
        self.middle.len()
    }

    /// Carries hidden states over every step by Runge-Kutta steps; `visit` sees them in the middle of each. Before a
    /// run's first step they say how far they are from rest in its first attitude.
    pub fn carry(
        &self,
        hidden: &mut [f64],
        derivative: impl Fn(&Environment<'_>, &[f64], &mut [f64]),
        mut visit: impl FnMut(&Environment<'_>, &[f64]),
    ) {
        // Most effects have two: room for more costs more than the two.
        match hidden.len() {
            0..=2 => self.carry_within::<2>(hidden, derivative, &mut visit),
            _ => self.carry_within::<MAX_HIDDEN_STATES>(hidden, derivative, &mut visit),
        }
    }

    /// As [`Self::carry`], with room for `S` hidden states.
    fn carry_within<const S: usize>(
        &self,
        hidden: &mut [f64],
        derivative: impl Fn(&Environment<'_>, &[f64], &mut [f64]),
        visit: &mut impl FnMut(&Environment<'_>, &[f64]),
    ) {
        let n = hidden.len().min(S);
        if let Some(start) = self.moving.first().filter(|_| self.begins) {
            let still = Environment {
                omega_wb_b_rad_s: Vector3::zeros(),
                omega_dot_wb_b_rad_s2: Vector3::zeros(),
                ..*start
            };
            let mut rest = [0.0; S];
            come_to_rest(&mut rest[..n], |x, rate| derivative(&still, x, rate));
            hidden.iter_mut().zip(rest).take(n).for_each(|(x, rest)| *x += rest);
        }
        for (step, middle) in self.middle.iter().enumerate() {
            if let Some([start, half, end]) = self.moving.get(2 * step..2 * step + 3) {
                let states = self.advance::<S>([start, half, end], hidden, &derivative);
                visit(middle, &states[..n]);
            }
        }
    }

    /// Carries hidden states over a step and returns those in its middle.
    fn advance<const S: usize>(
        &self,
        [start, middle, end]: [&Environment<'_>; 3],
        hidden: &mut [f64],
        derivative: &impl Fn(&Environment<'_>, &[f64], &mut [f64]),
    ) -> [f64; S] {
        let n = hidden.len().min(S);
        let rate = |environment: &Environment<'_>, x: &[f64]| {
            let mut rate = [0.0; S];
            derivative(environment, &x[..n], &mut rate[..n]);
            rate
        };
        let moved = |x: &[f64], rate: &[f64], dt: f64| {
            let mut y = [0.0; S];
            for ((slot, a), r) in y.iter_mut().zip(x).zip(rate) {
                *slot = a + r * dt;
            }
            y
        };
        let h = self.step_s;
        let k1 = rate(start, hidden);
        let k2 = rate(middle, &moved(hidden, &k1, 0.5 * h));
        let half = moved(hidden, &k2, 0.5 * h);
        let k3 = rate(middle, &half);
        let k4 = rate(end, &moved(hidden, &k3, h));
        for (i, x) in hidden.iter_mut().take(n).enumerate() {
            *x += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
        half
    }
}

/// Sets hidden states to where they do not change; their equations are linear: rate = rate(0) + J x. One that would
/// stay anywhere, a sum or a random walk, stays at zero.
fn come_to_rest(hidden: &mut [f64], derivative: impl Fn(&[f64], &mut [f64])) {
    let n = hidden.len();
    let rate = |x: &DVector<f64>| {
        let mut rate = DVector::zeros(n);
        derivative(x.as_slice(), rate.as_mut_slice());
        rate
    };
    let start = rate(&DVector::zeros(n));
    let mut slope = DMatrix::zeros(n, n);
    for i in 0..n {
        let mut x = DVector::zeros(n);
        x[i] = 1.0;
        slope.set_column(i, &(rate(&x) - &start));
    }
    // The shortest of all solutions.
    let negligible = 1e-12 * slope.amax();
    if let Ok(rest) = slope.svd(true, true).solve(&-start, negligible)
        && rest.iter().all(|v| v.is_finite())
    {
        hidden.copy_from_slice(rest.as_slice());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pendulum_in_a_slanted_field_hangs_where_the_spring_holds_it() {
        // s'' = -0.3 s' - 4 s + 2: at rest at one half.
        let mut hidden = [0.0, 0.0];
        come_to_rest(&mut hidden, |x, rate| (rate[0], rate[1]) = (x[1], -0.3 * x[1] - 4.0 * x[0] + 2.0));
        assert!((hidden[0] - 0.5).abs() < 1e-12 && hidden[1].abs() < 1e-12, "{hidden:?}");
        // The same beside an angle that only counts.
        let mut hidden = [0.0; 3];
        come_to_rest(&mut hidden, |x, rate| {
            (rate[0], rate[1], rate[2]) = (0.0, x[2], -0.3 * x[2] - 4.0 * x[1] + 2.0);
        });
        assert!(hidden[0].abs() < 1e-12 && (hidden[1] - 0.5).abs() < 1e-12, "{hidden:?}");
    }
}
