//! Effects with states of their own, carried along the filter's motion as laws: what each would do, per unit, if it were there.

use std::sync::{Mutex, PoisonError};

use nalgebra::{SVector, Vector3};
use whorl_dynamics::effects::MAX_HIDDEN_STATES;
use whorl_dynamics::{Effect, Environment, Plant};
use whorl_prediction::Push;

/// Longest step of hidden states \[s\]: at 15 Hz three quarters of a radian, over which a Runge-Kutta step loses a thousandth of the swing.
const LONGEST_STEP_S: f64 = 0.008;

type States = SVector<f64, MAX_HIDDEN_STATES>;

/// An effect with hidden states and values at which it does something.
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
        if time_ns < now.0 {
            *now = (time_ns, vec![States::zeros(); self.carried.len()]);
        }
        let step_s = (time_ns - std::mem::replace(&mut now.0, time_ns)) as f64 * 1e-9;
        let all = self.carried.iter().zip(&mut now.1);
        pushes.extend(all.map(|(carried, states)| Push::Body(carried.push(&environment, states, step_s))));
    }
}

impl Carried {
    /// Carries the states on; the torque on the body then [N m]. Parts that do not follow rigidly are in its inertia, which resists all the same.
    fn push(&self, environment: &Environment<'_>, states: &mut States, step_s: f64) -> Vector3<f64> {
        let count = self.effect.hidden_states(environment.model).min(MAX_HIDDEN_STATES);
        let steps = (step_s / LONGEST_STEP_S).ceil().clamp(0.0, 1e4);
        let h = step_s / steps.max(1.0);
        let derivative = |at: States| {
            let mut of = States::zeros();
            let (at, of_hidden) = (&at.as_slice()[..count], &mut of.as_mut_slice()[..count]);
            self.effect.hidden_derivative(&self.values, environment, at, of_hidden);
            of
        };
        for _ in 0..steps as usize {
            let k1 = derivative(*states);
            let k2 = derivative(*states + k1 * (0.5 * h));
            let k3 = derivative(*states + k2 * (0.5 * h));
            let k4 = derivative(*states + k3 * h);
            *states += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        }
        // Far from what a platform can hold nothing is left to be said.
        if states.iter().any(|x| !x.is_finite()) {
            *states = States::zeros();
        }
        self.effect.torque_b_n_m(&self.values, environment, &states.as_slice()[..count])
            + self.effect.reaction_inertia_b_kg_m2(&self.values, environment.model)
                * environment.omega_dot_wb_b_rad_s2
    }
}
