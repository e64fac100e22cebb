//! Wheels in motion: motors, friction, and stops where Coulomb friction holds them.

use nalgebra::{Matrix3, Vector3};

use super::{MAX_WHEELS, Wheel, Wheels};
use crate::actuators::dynamics::{Instant, KindDynamics, OnBody, Sliding};
use crate::effects::{EffectSet, ThrustLag};
use crate::platform::sensors::SensorSuite;
use crate::sensing::JointSample;
use crate::Environment;

/// A wheel's motor loses its torque over this last share of the largest speed, as back-EMF does.
const SPEED_LIMIT_BAND: f64 = 0.01;

/// Continuous states of the wheels; entries beyond the platform's own stay zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// Speeds relative to the body [rad/s].
    pub speed_rad_s: [f64; MAX_WHEELS],
}

/// What holds between two events.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Motor torques, within the motors' limits [N m].
    pub motor_torque_n_m: [f64; MAX_WHEELS],
    /// Sense of sliding of each wheel's bearing, -1 or 1; 0 where Coulomb friction holds the wheel.
    sliding: [f64; MAX_WHEELS],
    /// Wheels held by Coulomb friction.
    stuck: [bool; MAX_WHEELS],
}

impl Drive {
    /// Whether a wheel is held by Coulomb friction.
    pub fn holds(&self, wheel: usize) -> bool {
        self.stuck.get(wheel).copied().unwrap_or(false)
    }
}

/// Torque on each wheel about its axis: motor, friction and effects [N m].
pub(crate) type Forces = [f64; MAX_WHEELS];

// Array sizes were checked in `Gyrostat::new`: no index below can be out of bounds.
impl KindDynamics for Wheels {
    type State = State;
    type Drive = Drive;
    type Forces = Forces;

    fn idle(&self, _lag: ThrustLag, _now_ns: i64) -> Drive {
        Drive {
            motor_torque_n_m: [0.0; MAX_WHEELS],
            sliding: [0.0; MAX_WHEELS],
            stuck: [false; MAX_WHEELS],
        }
    }

    #[inline]
    fn moved(&self, state: &State, rate: &State, factor: f64, to: &mut State) {
        let speeds = state.speed_rad_s.iter().zip(&rate.speed_rad_s).take(self.0.len());
        for (to, (speed, rate)) in to.speed_rad_s.iter_mut().zip(speeds) {
            *to = speed + factor * rate;
        }
    }

    #[inline]
    fn add_scaled(&self, state: &mut State, rate: &State, factor: f64) {
        for (sum, x) in state.speed_rad_s.iter_mut().zip(&rate.speed_rad_s).take(self.0.len()) {
            *sum += factor * x;
        }
    }

    #[inline]
    fn is_finite(&self, state: &State) -> bool {
        state.speed_rad_s.iter().all(|speed| speed.is_finite())
    }

    #[inline]
    fn show<'a>(&'a self, state: &'a State, drive: &'a Drive, environment: &mut Environment<'a>) -> f64 {
        let motor_torque_n_m = drive.motor_torque_n_m.get(..self.0.len()).unwrap_or(&[]);
        environment.wheel_speed_rad_s = state.speed_rad_s.get(..self.0.len()).unwrap_or(&[]);
        environment.wheel_motor_torque_n_m = motor_torque_n_m;
        motor_torque_n_m.iter().map(|u| u.abs()).sum()
    }

    #[inline]
    fn add_momentum(&self, state: &State, sum_b_n_m_s: &mut Vector3<f64>) {
        for (wheel, speed) in self.0.iter().zip(&state.speed_rad_s) {
            *sum_b_n_m_s += wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * speed);
        }
    }

    fn take_out(&self, drive: Option<&Drive>, left: &mut Matrix3<f64>) {
        // I - A J A^T, of the wheels that turn freely.
        for (j, wheel) in self.0.iter().enumerate() {
            if drive.is_none_or(|drive| !drive.stuck[j]) {
                let axis = wheel.spin_axis_b.into_inner();
                *left -= axis * axis.transpose() * wheel.spin_inertia_kg_m2;
            }
        }
    }

    #[inline]
    fn act(
        &self,
        _at: &Instant,
        state: &State,
        drive: &Drive,
        _omega_wb_b_rad_s: &Vector3<f64>,
        _body: &mut OnBody,
        torque_n_m: &mut Forces,
    ) {
        for (j, wheel) in self.0.iter().enumerate() {
            let speed = state.speed_rad_s[j];
            torque_n_m[j] =
                available_motor_torque_n_m(drive.motor_torque_n_m[j], speed, wheel.max_speed_rad_s)
                    + friction_n_m(wheel, speed, drive.sliding[j]);
        }
    }

    #[inline]
    fn add_effects(
        &self,
        effects: &EffectSet,
        environment: &Environment<'_>,
        _state: &State,
        torque_n_m: &mut Forces,
    ) {
        effects.add_wheel_torque_n_m(environment, &mut torque_n_m[..self.0.len()]);
    }

    #[inline]
    fn add_reaction(&self, drive: &Drive, torque_n_m: &Forces, sum_b_n_m: &mut Vector3<f64>) {
        for ((wheel, torque), stuck) in self.0.iter().zip(torque_n_m).zip(&drive.stuck) {
            if !stuck {
                *sum_b_n_m += wheel.spin_axis_b.into_inner() * *torque;
            }
        }
    }

    #[inline]
    fn rate(
        &self,
        _state: &State,
        drive: &Drive,
        torque_n_m: &Forces,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
        to: &mut State,
    ) {
        let wheels = self.0.iter().zip(torque_n_m).zip(&drive.stuck);
        for (to, ((wheel, torque), stuck)) in to.speed_rad_s.iter_mut().zip(wheels) {
            *to = if *stuck {
                0.0
            } else {
                torque / wheel.spin_inertia_kg_m2 - wheel.spin_axis_b.dot(omega_dot_wb_b_rad_s2)
            };
        }
    }

    fn set_out(&self, state: &State, drive: &mut Drive) {
        for j in 0..self.0.len() {
            self.set_sliding(drive, j, sign(state.speed_rad_s[j]));
        }
    }

    /// A wheel that its bearing cannot hold slips: friction gives its most in the direction that holds, and the wheel
    /// goes the other way.
    #[inline]
    fn first_slip<'a>(
        &self,
        effects: &EffectSet,
        environment: &dyn Fn() -> Environment<'a>,
        drive: &Drive,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> Option<(usize, f64)> {
        if !drive.stuck.iter().take(self.0.len()).any(|stuck| *stuck) {
            return None;
        }
        let mut torque_n_m = drive.motor_torque_n_m;
        if !effects.is_empty() {
            effects.add_wheel_torque_n_m(&environment(), &mut torque_n_m[..self.0.len()]);
        }
        self.0.iter().enumerate().filter(|(j, _)| drive.stuck[*j]).find_map(|(j, wheel)| {
            let needed_n_m =
                wheel.spin_inertia_kg_m2 * wheel.spin_axis_b.dot(omega_dot_wb_b_rad_s2) - torque_n_m[j];
            (needed_n_m.abs() > wheel.coulomb_friction_n_m).then(|| (j, -sign(needed_n_m)))
        })
    }

    #[inline]
    fn first_stop(&self, from: &State, to: &State, drive: &Drive, h_s: f64) -> Option<(usize, f64)> {
        let parts = self.0.iter().enumerate().filter(|(j, _)| !drive.stuck[*j]);
        let under_friction = parts.filter(|(_, wheel)| wheel.coulomb_friction_n_m > 0.0);
        let sliding = under_friction.map(|(j, _)| Sliding {
            part: j,
            sense: drive.sliding[j],
            from: from.speed_rad_s[j],
            to: to.speed_rad_s[j],
        });
        Sliding::first_to_stop(sliding, h_s)
    }

    fn speed(&self, state: &State, wheel: usize) -> f64 {
        state.speed_rad_s.get(wheel).copied().unwrap_or(0.0)
    }

    fn slide(&self, state: &mut State, drive: &mut Drive, wheel: usize, sense: f64) {
        if sense == 0.0
            && let Some(speed) = state.speed_rad_s.get_mut(wheel)
        {
            *speed = 0.0;
        }
        self.set_sliding(drive, wheel, sense);
    }

    fn sample(
        &self,
        state: &State,
        drive: &Drive,
        sensors: &SensorSuite,
        noise: &mut dyn FnMut() -> f64,
    ) -> JointSample {
        let speeds = state.speed_rad_s.iter().take(self.0.len());
        JointSample {
            position_rad: Vec::new(),
            velocity_rad_s: speeds
                .map(|speed| sensors.wheel_speed.reading_rad_s(*speed, noise()))
                .collect(),
            effort_n_m: drive.motor_torque_n_m.iter().take(self.0.len()).copied().collect(),
        }
    }

    fn command(&self, drive: &mut Drive, torque_n_m: &[f64]) {
        for ((slot, wheel), asked) in drive.motor_torque_n_m.iter_mut().zip(&self.0).zip(torque_n_m) {
            *slot = asked.max(-wheel.max_torque_n_m).min(wheel.max_torque_n_m);
        }
    }
}

impl Wheels {
    /// Sets the sense of sliding of a wheel's bearing; 0 = stuck, if it has Coulomb friction.
    fn set_sliding(&self, drive: &mut Drive, wheel: usize, sense: f64) {
        let has_friction = self.0.get(wheel).is_some_and(|w| w.coulomb_friction_n_m > 0.0);
        if let (Some(sliding), Some(stuck)) = (drive.sliding.get_mut(wheel), drive.stuck.get_mut(wheel)) {
            *sliding = sense;
            *stuck = has_friction && sense == 0.0;
        }
    }
}

/// Friction torque on a wheel [N m] for the given sense of sliding (-1, 0, 1).
#[inline]
pub(crate) fn friction_n_m(wheel: &Wheel, speed_rad_s: f64, sense: f64) -> f64 {
    -wheel.viscous_friction_n_m_s * speed_rad_s - wheel.coulomb_friction_n_m * sense
}

/// By how much the torque of a wheel's motor and bearing changes with its speed [N m s].
pub(crate) fn torque_by_speed_n_m_s(wheel: &Wheel, drive: &Drive, j: usize, state: &State) -> f64 {
    let (asked_n_m, speed) = (drive.motor_torque_n_m[j], state.speed_rad_s[j]);
    let band = SPEED_LIMIT_BAND * wheel.max_speed_rad_s;
    let share = (wheel.max_speed_rad_s - speed.abs()) / band;
    let is_losing = asked_n_m * speed > 0.0 && share > 0.0 && share < 1.0;
    let of_motor = if is_losing { -asked_n_m * speed.signum() / band } else { 0.0 };
    of_motor - wheel.viscous_friction_n_m_s
}

/// -1, 0 or 1.
#[inline]
pub(crate) fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// What the motor can give at this speed of what it was asked: less and less torque that would
/// exceed the largest speed.
pub(crate) fn available_motor_torque_n_m(asked_n_m: f64, speed_rad_s: f64, max_speed_rad_s: f64) -> f64 {
    if asked_n_m * speed_rad_s <= 0.0 {
        return asked_n_m;
    }
    let band = SPEED_LIMIT_BAND * max_speed_rad_s;
    asked_n_m * ((max_speed_rad_s - speed_rad_s.abs()) / band).clamp(0.0, 1.0)
}
