//! The right-hand side of the equations of motion.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use whorl_math::{quaternion_rate, vertical_b};

use super::{Gyrostat, RateEquation, State};
use crate::Environment;
use crate::actuators::wheels::MAX_WHEELS;
use crate::actuators::{Actuators, Drives, Forces, Instant, OnBody, States};
use crate::effects::{MAX_HIDDEN_STATES, Touching, contact_torque_b_n_m, is_clear};

/// Stiffness of the bearing's own stop over the mean moment of inertia [1/s^2]: a platform rebounds within 0.25 s and
/// sinks in by less than half a degree at 0.1 rad/s.
const STOP_STIFFNESS_S2: f64 = 2000.0 / 8.6;
/// Damping of the bearing's own stop over the mean moment of inertia [1/s]: about a third of critical.
const STOP_DAMPING_S: f64 = 100.0 / 8.6;

/// Time derivative of [`State`]; entries beyond the platform's own parts and hidden states stay zero.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Derivative {
    pub quaternion: Quaternion<f64>,
    pub omega: Vector3<f64>,
    pub actuators: States,
    pub hidden: [f64; MAX_HIDDEN_STATES],
}

/// Torques that fade at different rates at most.
pub const MAX_DISTURBANCES: usize = 3;

/// Torques that fade.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Fading<T> {
    /// At `since_s` [N m]: on the body, body axes, or on each wheel about its axis.
    pub torque_n_m: T,
    /// Time since the start of the run \[s\].
    pub since_s: f64,
    /// Inverse of the time in which it fades [1/s].
    pub rate_1_s: f64,
}

impl<T: Copy + Default + PartialEq> Fading<T> {
    /// The torques as they were, and what is left of them; `None` where there are none.
    fn at(&self, time_s: f64) -> Option<(T, f64)> {
        let left = || (-self.rate_1_s * (time_s - self.since_s)).exp();
        (self.torque_n_m != T::default()).then(|| (self.torque_n_m, left()))
    }
}

/// Constant during a segment between two events.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Commands to the actuators, and which of them stick or are open.
    pub actuators: Drives,
    /// The equation of motion with the stuck parts fixed.
    pub equation: RateEquation,
    /// Torque on the body from outside the platform, body axes [N m].
    pub body_torque_b_n_m: Vector3<f64>,
    /// Torques besides it that nobody commands: an estimate's.
    pub disturbances: [Fading<Vector3<f64>>; MAX_DISTURBANCES],
    /// The same of the wheels' motors.
    pub motor_disturbances: Fading<[f64; MAX_WHEELS]>,
    /// The body is held still (wheel bench test).
    pub clamped: bool,
    /// Branch of the bearing's own stop.
    pub stop: Touching,
    /// Branch of contacts among the effects.
    pub contact: Touching,
}

impl Drive {
    pub fn idle(gyrostat: &Gyrostat, now_ns: i64) -> Self {
        Self {
            actuators: gyrostat.model().actuators.idle(gyrostat.thrust_lag(), now_ns),
            equation: *gyrostat.rate_equation(),
            body_torque_b_n_m: Vector3::zeros(),
            disturbances: [Fading::default(); MAX_DISTURBANCES],
            motor_disturbances: Fading::default(),
            clamped: false,
            stop: Touching::AsItIs,
            contact: Touching::AsItIs,
        }
    }
}

impl State {
    /// This state moved along `derivative` for `dt_s`, into `to`, a state of the same platform. The quaternion is not
    /// normalised: the stages of a Runge-Kutta step leave the sphere by design, its end is normalised.
    #[inline]
    pub(crate) fn moved(
        &self,
        derivative: &Derivative,
        dt_s: f64,
        actuators: &Actuators,
        hidden: usize,
        to: &mut Self,
    ) {
        to.q_world_body =
            UnitQuaternion::new_unchecked(self.q_world_body.into_inner() + derivative.quaternion * dt_s);
        to.omega_wb_b_rad_s = self.omega_wb_b_rad_s + derivative.omega * dt_s;
        actuators.moved(&self.actuators, &derivative.actuators, dt_s, &mut to.actuators);
        let hidden_states = self.hidden.iter().zip(&derivative.hidden).take(hidden);
        for (to, (x, rate)) in to.hidden.iter_mut().zip(hidden_states) {
            *to = x + rate * dt_s;
        }
    }
}

impl Derivative {
    /// No motion.
    pub fn zero() -> Self {
        Self {
            quaternion: Quaternion::new(0.0, 0.0, 0.0, 0.0),
            omega: Vector3::zeros(),
            actuators: States::default(),
            hidden: [0.0; MAX_HIDDEN_STATES],
        }
    }

    /// self += factor * other.
    #[inline]
    fn add_scaled(&mut self, other: &Self, factor: f64, actuators: &Actuators, hidden: usize) {
        self.quaternion += other.quaternion * factor;
        self.omega += other.omega * factor;
        actuators.add_scaled(&mut self.actuators, &other.actuators, factor);
        for (sum, x) in self.hidden.iter_mut().zip(&other.hidden).take(hidden) {
            *sum += factor * x;
        }
    }

    /// (k1 + 2 k2 + 2 k3 + k4), six times the mean of a Runge-Kutta step, into `self`.
    #[inline]
    pub fn set_runge_kutta_sum(
        &mut self,
        [k1, k2, k3, k4]: [&Self; 4],
        actuators: &Actuators,
        hidden: usize,
    ) {
        self.quaternion = k1.quaternion + k2.quaternion * 2.0;
        self.omega = k1.omega + k2.omega * 2.0;
        actuators.moved(&k1.actuators, &k2.actuators, 2.0, &mut self.actuators);
        let of_hidden = k1.hidden.iter().zip(&k2.hidden).take(hidden);
        for (sum, (k1, k2)) in self.hidden.iter_mut().zip(of_hidden) {
            *sum = k1 + 2.0 * k2;
        }
        self.add_scaled(k3, 2.0, actuators, hidden);
        self.add_scaled(k4, 1.0, actuators, hidden);
    }
}

impl Gyrostat {
    /// What effects see in this state. `omega_dot` is zero while it is unknown.
    #[inline]
    pub(crate) fn environment<'a>(
        &'a self,
        time_s: f64,
        state: &'a State,
        drive: &'a Drive,
    ) -> Environment<'a> {
        let (bus, sensors) = (&self.model.bus, &self.model.sensors);
        let mut environment = Environment::new(&self.model, state.q_world_body, state.omega_wb_b_rad_s);
        environment.time_s = time_s;
        let load = self.model.actuators.show(&state.actuators, &drive.actuators, &mut environment);
        environment.bus_voltage_v = match &self.supplies.bus_voltage_v {
            Some(course) => course.at(time_s),
            None => bus.initial_v - bus.discharge_v_s * time_s - bus.sag_v_n_m * load,
        };
        environment.touching = drive.contact;
        environment.temperature_k = match &self.supplies.temperature_k {
            Some(course) => course.at(time_s),
            None => sensors.ambient_temperature_k + sensors.temperature_drift_k_s * time_s,
        };
        environment
    }

    /// Torque of the bearing's own stop, body axes [N m]; `None`: none for certain.
    #[inline]
    fn stop_torque_b_n_m(
        &self,
        vertical_b: &Vector3<f64>,
        omega_wb_b_rad_s: &Vector3<f64>,
        touching: Touching,
    ) -> Option<Vector3<f64>> {
        if is_clear(&self.model.tilt_limit, vertical_b, touching) {
            return None;
        }
        let mean_inertia_kg_m2 = self.model.mass_properties.inertia_b_kg_m2().trace() / 3.0;
        Some(contact_torque_b_n_m(
            &self.model.tilt_limit,
            STOP_STIFFNESS_S2 * mean_inertia_kg_m2,
            STOP_DAMPING_S * mean_inertia_kg_m2,
            vertical_b,
            omega_wb_b_rad_s,
            touching,
        ))
    }

    /// Torque of the bearing's stop, and that of the contacts among the effects, body axes [N m]; zero: it does not touch.
    #[inline]
    pub(crate) fn contact_torques_b_n_m(
        &self,
        time_s: f64,
        state: &State,
        drive: &Drive,
    ) -> [Vector3<f64>; 2] {
        let vertical_b = vertical_b(&state.q_world_body);
        let stop = self.stop_torque_b_n_m(&vertical_b, &state.omega_wb_b_rad_s, Touching::AsItIs);
        let has_contact = self.effects.has_contact();
        let of_effects =
            has_contact.then(|| self.effects.contact_torque_b_n_m(&self.environment(time_s, state, drive)));
        [stop, of_effects].map(Option::unwrap_or_default)
    }

    /// Time derivative of `state`, into `to`, which with `forces` was made for this platform or holds zeros.
    pub(crate) fn derivative(
        &self,
        at: &Instant,
        state: &State,
        drive: &Drive,
        forces: &mut Forces,
        to: &mut Derivative,
    ) {
        let omega = state.omega_wb_b_rad_s;
        let vertical_b = vertical_b(&state.q_world_body);
        let actuators = &self.model.actuators;
        let momentum = self.total_momentum_b_n_m_s(state);
        let environment = self.effects.any_acts().then(|| self.environment(at.time_s, state, drive));
        // Asked for long before it is used: what comes back through memory is late otherwise.
        let of_effects = environment.as_ref().map(|seen| self.effects.torque_b_n_m(seen, &state.hidden));
        let mut body = OnBody {
            torque_b_n_m: Vector3::zeros(),
            thrust_factor: environment.as_ref().map_or(1.0, |seen| self.effects.thrust_factor(seen)),
            gravity_offset_b_n_m: *self.model.mass_properties.gravity_offset_b_n_m(),
        };
        actuators.act(at, &state.actuators, &drive.actuators, &omega, &mut body, forces);
        let mut torque = body.torque_b_n_m
            + drive.body_torque_b_n_m
            + drive
                .disturbances
                .iter()
                .filter_map(|of| of.at(at.time_s))
                .map(|(of, left)| of * left)
                .sum::<Vector3<f64>>()
            + drive.equation.gravity_torque_n_m(&body.gravity_offset_b_n_m, &vertical_b);
        if let Some(of_stop) = self.stop_torque_b_n_m(&vertical_b, &omega, drive.stop) {
            torque += of_stop;
        }
        if let Some((environment, of_effects)) = environment.as_ref().zip(of_effects) {
            torque += of_effects;
            actuators.add_effects(&self.effects, environment, &state.actuators, forces);
        }
        if let Some((of_motors, left)) = drive.motor_disturbances.at(at.time_s) {
            forces.wheels.iter_mut().zip(of_motors).for_each(|(sum, torque_n_m)| *sum += torque_n_m * left);
        }

        let omega_dot = if drive.clamped {
            Vector3::zeros()
        } else {
            let reaction = actuators.reaction_b_n_m(&drive.actuators, forces);
            drive.equation.acceleration_b_rad_s2(&omega, &momentum, &torque, &reaction)
        };
        if let Some(mut environment) = environment.filter(|_| self.effects.hidden_states() > 0) {
            environment.omega_dot_wb_b_rad_s2 = omega_dot;
            to.hidden = [0.0; MAX_HIDDEN_STATES];
            self.effects.hidden_derivative(&environment, &state.hidden, &mut to.hidden);
        }
        to.quaternion = quaternion_rate(&state.q_world_body, &omega);
        to.omega = omega_dot;
        actuators.rates(&state.actuators, &drive.actuators, forces, &omega_dot, &mut to.actuators);
    }
}
