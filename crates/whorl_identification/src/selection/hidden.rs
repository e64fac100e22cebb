//! Effects with states of their own, carried along the filter's motion as laws: what each would do, per unit, if it were there.

use std::sync::{Mutex, PoisonError};

use nalgebra::Vector3;
use whorl_dynamics::effects::MAX_HIDDEN_STATES;
use whorl_dynamics::{Effect, Environment, Plant};
use whorl_prediction::Push;

/// Longest step of hidden states \[s\]: of a mode at 15 Hz three quarters of a radian, over which a Runge-Kutta step loses a thousandth
/// of the swing.
const LONGEST_STEP_S: f64 = 0.008;

type States = [f64; MAX_HIDDEN_STATES];

/// An effect with hidden states and values at which it does something.
#[derive(Debug, Clone)]
pub(crate) struct Carried {
    pub effect: &'static dyn Effect,
    pub values: Vec<f64>,
}

/// Hidden states of several effects on their way through one run.
pub(crate) struct Carriage<'a> {
    carried: &'a [Carried],
    /// Now \[ns\], and the states of each.
    now: Mutex<(i64, Vec<States>)>,
}

impl<'a> Carriage<'a> {
    pub fn new(carried: &'a [Carried]) -> Self {
        Self { carried, now: Mutex::new((i64::MAX, Vec::new())) }
    }

    /// Appends the torque of each in the state of a plant, to which its hidden states are carried.
    pub fn push(&self, plant: &Plant, pushes: &mut Vec<Push>) {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        let (environment, time_ns) = (plant.environment(), plant.now_ns());
        // Another pass begins.
        if time_ns < now.0 {
            *now = (time_ns, vec![[0.0; MAX_HIDDEN_STATES]; self.carried.len()]);
        }
        let step_s = (time_ns - now.0) as f64 * 1e-9;
        now.0 = time_ns;
        for (carried, states) in self.carried.iter().zip(&mut now.1) {
            carried.carry(&environment, states, step_s);
            pushes.push(Push::Body(carried.torque_b_n_m(&environment, states)));
        }
    }
}

impl Carried {
    fn count(&self, environment: &Environment<'_>) -> usize {
        self.effect.hidden_states(environment.model).min(MAX_HIDDEN_STATES)
    }

    fn carry(&self, environment: &Environment<'_>, states: &mut States, step_s: f64) {
        let count = self.count(environment);
        let steps = (step_s / LONGEST_STEP_S).ceil().clamp(0.0, 1e4);
        let h = step_s / steps.max(1.0);
        let derivative = |at: &States| {
            let mut of = [0.0; MAX_HIDDEN_STATES];
            self.effect.hidden_derivative(&self.values, environment, &at[..count], &mut of[..count]);
            of
        };
        let along = |at: &States, by: &States, h: f64| std::array::from_fn(|i| at[i] + h * by[i]);
        for _ in 0..steps as usize {
            let k1 = derivative(states);
            let k2 = derivative(&along(states, &k1, 0.5 * h));
            let k3 = derivative(&along(states, &k2, 0.5 * h));
            let k4 = derivative(&along(states, &k3, h));
            *states = std::array::from_fn(|i| states[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        // Far from what a platform can hold nothing is left to be said.
        if states.iter().any(|x| !x.is_finite()) {
            *states = [0.0; MAX_HIDDEN_STATES];
        }
    }

    /// On the body; the parts that do not follow it rigidly are part of its inertia, which resists all the same.
    fn torque_b_n_m(&self, environment: &Environment<'_>, states: &States) -> Vector3<f64> {
        let hidden = &states[..self.count(environment)];
        self.effect.torque_b_n_m(&self.values, environment, hidden)
            + self.effect.reaction_inertia_b_kg_m2(&self.values, environment.model)
                * environment.omega_dot_wb_b_rad_s2
    }
}
