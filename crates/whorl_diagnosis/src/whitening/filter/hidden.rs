//! Hidden states of effects: nobody sees where they are when a recording begins.
//!
//! What drives them is the motion that was seen, whatever the filter's errors of it are, so that their own errors follow
//! their own equations alone. These are linear, and push the body.

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_dynamics::Environment;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_math::vertical_b;

use super::{ANGLE, MOST_STATES, RATE, System, WHEEL};

/// Longest step of the transition \[s\]: an eighth of a radian at 2 Hz.
const LONGEST_STEP_S: f64 = 0.01;

/// Equations of hidden states over an interval, as they were last needed.
#[derive(Debug, Default)]
pub(super) struct HiddenStates {
    length_s: f64,
    slope: DMatrix<f64>,
    /// From its start to its end.
    transition: DMatrix<f64>,
    /// From its start to the mean over it.
    mean: DMatrix<f64>,
}

impl HiddenStates {
    fn set(&mut self, slope: DMatrix<f64>, length_s: f64) {
        if self.length_s == length_s && self.slope == slope {
            return;
        }
        let n = slope.nrows();
        let steps = (length_s / LONGEST_STEP_S).ceil().clamp(1.0, 1e3);
        let over = |step_s: f64| {
            // The exponential's series.
            let (mut sum, mut term) = (DMatrix::identity(n, n), DMatrix::identity(n, n));
            for order in 1..=4 {
                term = &term * &slope * (step_s / f64::from(order));
                sum += &term;
            }
            sum
        };
        let (whole, half) = (over(length_s / steps), over(0.5 * length_s / steps));
        (self.transition, self.mean) = (DMatrix::identity(n, n), DMatrix::zeros(n, n));
        for _ in 0..steps as usize {
            self.mean += &half * &self.transition / steps;
            self.transition = &whole * &self.transition;
        }
        (self.length_s, self.slope) = (length_s, slope);
    }
}

impl System<'_> {
    /// Hidden states that may be anywhere at the start, with those of all effects before the last of them.
    pub(super) fn hidden_states(&self) -> usize {
        let effects = self.mechanics.gyrostat.effects();
        if effects.hidden_states() == 0 || self.run.clamped {
            return 0;
        }
        let stddev = effects.hidden_start_stddev(self.mechanics.model(), 1.0);
        let last = stddev.iter().rposition(|stddev| *stddev > 0.0).map_or(0, |last| last + 1);
        last.min(MOST_STATES - self.first_hidden())
    }

    /// Standard deviation of hidden states at the start. The torque that an earlier motion leaves is taken to be no larger than
    /// the largest torque of the run.
    pub(super) fn hidden_start_stddev(&self) -> Vec<f64> {
        let intervals = self.motion.omega.iter().zip(self.motion.omega.iter().skip(1)).enumerate();
        let strongest = |(k, (now, next)): (usize, (&Vector3<f64>, &Vector3<f64>))| {
            (next - now).norm() / self.run.length(k).max(1e-9)
        };
        let fastest_rad_s2 = intervals.map(strongest).fold(0.0, f64::max);
        let model = self.mechanics.model();
        let torque_n_m = fastest_rad_s2 * model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        self.mechanics.gyrostat.effects().hidden_start_stddev(model, torque_n_m)
    }

    /// Puts what hidden states do over interval `k` into a transition, n x n.
    pub(super) fn hidden_transition(&self, k: usize, hidden: &mut HiddenStates, f: &mut [f64]) {
        let (n, first, count) = (self.states(), self.first_hidden(), self.hidden_states());
        let (Some(q), Some(omega)) = (self.motion.q_mid.get(k), self.motion.omega_mid.get(k)) else { return };
        if count == 0 {
            return;
        }
        let (model, gyrostat) = (self.mechanics.model(), &self.mechanics.gyrostat);
        let effects = gyrostat.effects();
        let environment = Environment {
            q_world_body: *q,
            vertical_b: vertical_b(q),
            omega_wb_b_rad_s: *omega,
            ..self.run.environment(model, k)
        };
        let rate = |state: &DVector<f64>| {
            let mut rate = DVector::zeros(state.len());
            effects.hidden_derivative(&environment, state.as_slice(), rate.as_mut_slice());
            rate
        };
        let at_rest = DVector::zeros(effects.hidden_states());
        let (rate_at_rest, torque_at_rest) =
            (rate(&at_rest), effects.torque_b_n_m(&environment, at_rest.as_slice()));
        let mut slope = DMatrix::zeros(count, count);
        let mut torque = Vec::with_capacity(count);
        let stddev = effects.hidden_start_stddev(model, 1.0);
        for (i, stddev) in stddev.iter().enumerate().take(count) {
            if *stddev == 0.0 {
                torque.push(Vector3::zeros());
                continue;
            }
            let mut moved = at_rest.clone();
            moved[i] = 1.0;
            slope.set_column(i, &(rate(&moved) - &rate_at_rest).rows(0, count));
            torque.push(effects.torque_b_n_m(&environment, moved.as_slice()) - torque_at_rest);
        }
        let h = self.run.length(k);
        hidden.set(slope, h);
        for i in 0..count {
            let torque: Vector3<f64> =
                torque.iter().zip(hidden.mean.column(i).iter()).map(|(t, x)| t * *x).sum();
            let omega_dot = self.mechanics.inverse_inertia() * torque;
            let wheels =
                gyrostat.wheel_accelerations_rad_s2(&[0.0; MAX_WHEELS], &[false; MAX_WHEELS], &omega_dot);
            let column = first + i;
            for axis in 0..3 {
                f[(ANGLE + axis) * n + column] = 0.5 * h * h * omega_dot[axis];
                f[(RATE + axis) * n + column] = h * omega_dot[axis];
            }
            for (j, rate) in wheels.iter().enumerate().take(self.wheels()) {
                f[(WHEEL + j) * n + column] = h * rate;
            }
            for other in 0..count {
                f[(first + other) * n + column] = hidden.transition[(other, i)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damped_swing_follows_its_closed_form() {
        // x'' = -2 z w x' - w^2 x over a fifth of a second, from a deflection of one at rest.
        let (w, z, h) = (std::f64::consts::TAU * 2.0, 0.05, 0.2);
        let mut hidden = HiddenStates::default();
        hidden.set(DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -w * w, -2.0 * z * w]), h);
        let wd = w * f64::sqrt(1.0 - z * z);
        let at = |t: f64| (-z * w * t).exp() * ((wd * t).cos() + z * w / wd * (wd * t).sin());
        assert!((hidden.transition[(0, 0)] - at(h)).abs() < 1e-5, "{} {}", hidden.transition, at(h));
        let mean = (0..1000).map(|i| at((f64::from(i) + 0.5) / 1000.0 * h)).sum::<f64>() / 1000.0;
        // By the rule of midpoints, with steps of an eighth of a radian.
        assert!((hidden.mean[(0, 0)] - mean).abs() < 2e-3, "{} {mean}", hidden.mean);
    }
}
