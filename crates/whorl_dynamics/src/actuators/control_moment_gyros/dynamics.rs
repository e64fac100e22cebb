//! Gimbals in motion.

use nalgebra::{Matrix3, Vector3};

use super::{ControlMomentGyros, MAX_GYROS};
use crate::effects::{EffectSet, ThrustLag};
use crate::actuators::dynamics::{Instant, KindDynamics, OnBody, Sliding};
use crate::platform::sensors::SensorSuite;
use crate::actuators::wheels::sign;
use crate::sensing::JointSample;
use crate::Environment;

/// Continuous states of the gimbals; entries beyond the platform's own stay zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// Gimbal angles \[rad\].
    pub angle_rad: [f64; MAX_GYROS],
    /// Gimbal rates [rad/s].
    pub rate_rad_s: [f64; MAX_GYROS],
}

/// What holds between two events.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Rates asked of the gimbals, within their limits [rad/s].
    rate_rad_s: [f64; MAX_GYROS],
    /// Sense of sliding of each gimbal's bearing, -1 or 1; 0 where Coulomb friction holds the gimbal.
    sliding: [f64; MAX_GYROS],
    /// Gimbals held by Coulomb friction.
    stuck: [bool; MAX_GYROS],
    /// Angle at which each gimbal came to rest \[rad\].
    held_rad: [f64; MAX_GYROS],
    /// Gimbals whose motion is given rather than found.
    pub along: [bool; MAX_GYROS],
}

impl Drive {
    /// Whether a gimbal turns as the torques on it say.
    fn is_free(&self, gyro: usize) -> bool {
        !self.stuck[gyro] && !self.along[gyro]
    }
}

/// Of each gyro: torque with which the body turns its rotor h0 dgamma/dt t, body axes, and the torque about the gimbal
/// axis u + h0 t . w [N m].
pub(crate) type Forces = [(Vector3<f64>, f64); MAX_GYROS];

impl KindDynamics for ControlMomentGyros {
    type State = State;
    type Drive = Drive;
    type Forces = Forces;

    fn idle(&self, _lag: ThrustLag, _now_ns: i64) -> Drive {
        Drive {
            rate_rad_s: [0.0; MAX_GYROS],
            sliding: [0.0; MAX_GYROS],
            stuck: [false; MAX_GYROS],
            held_rad: [0.0; MAX_GYROS],
            along: [false; MAX_GYROS],
        }
    }

    #[inline]
    fn moved(&self, state: &State, rate: &State, factor: f64, to: &mut State) {
        for j in 0..self.0.len() {
            to.angle_rad[j] = state.angle_rad[j] + factor * rate.angle_rad[j];
            to.rate_rad_s[j] = state.rate_rad_s[j] + factor * rate.rate_rad_s[j];
        }
    }

    #[inline]
    fn add_scaled(&self, state: &mut State, rate: &State, factor: f64) {
        for j in 0..self.0.len() {
            state.angle_rad[j] += factor * rate.angle_rad[j];
            state.rate_rad_s[j] += factor * rate.rate_rad_s[j];
        }
    }

    #[inline]
    fn is_finite(&self, state: &State) -> bool {
        state.angle_rad.iter().chain(&state.rate_rad_s).all(|x| x.is_finite())
    }

    #[inline]
    fn show<'a>(&'a self, state: &'a State, _drive: &'a Drive, environment: &mut Environment<'a>) -> f64 {
        environment.gimbal_angle_rad = state.angle_rad.get(..self.0.len()).unwrap_or(&[]);
        environment.gimbal_rate_rad_s = state.rate_rad_s.get(..self.0.len()).unwrap_or(&[]);
        0.0
    }

    #[inline]
    fn add_momentum(&self, state: &State, sum_b_n_m_s: &mut Vector3<f64>) {
        for (j, gyro) in self.0.iter().enumerate() {
            *sum_b_n_m_s += gyro.axes_b(state.angle_rad[j]).0 * gyro.rotor_momentum_n_m_s
                + gyro.gimbal_axis_b.into_inner() * (gyro.gimbal_inertia_kg_m2 * state.rate_rad_s[j]);
        }
    }

    /// Models know the motion of gimbals, not their torque: only in the plant their inertia does not resist.
    fn take_out(&self, drive: Option<&Drive>, left: &mut Matrix3<f64>) {
        let Some(drive) = drive else { return };
        for (_, gyro) in self.0.iter().enumerate().filter(|(j, _)| drive.is_free(*j)) {
            let axis = gyro.gimbal_axis_b.into_inner();
            *left -= axis * axis.transpose() * gyro.gimbal_inertia_kg_m2;
        }
    }

    #[inline]
    fn act(
        &self,
        _at: &Instant,
        state: &State,
        drive: &Drive,
        omega_wb_b_rad_s: &Vector3<f64>,
        _body: &mut OnBody,
        forces: &mut Forces,
    ) {
        for (j, gyro) in self.0.iter().enumerate() {
            let across = gyro.axes_b(state.angle_rad[j]).1 * gyro.rotor_momentum_n_m_s;
            let rate = state.rate_rad_s[j];
            let motor_n_m = gyro.motor_torque_n_m(drive.rate_rad_s[j], state.angle_rad[j], rate);
            let friction_n_m =
                gyro.viscous_friction_n_m_s * rate + gyro.coulomb_friction_n_m * drive.sliding[j];
            let about_gimbal = motor_n_m - friction_n_m + across.dot(omega_wb_b_rad_s);
            forces[j] = (across * rate, if drive.is_free(j) { about_gimbal } else { 0.0 });
        }
    }

    #[inline]
    fn add_reaction(&self, _drive: &Drive, forces: &Forces, sum_b_n_m: &mut Vector3<f64>) {
        for (gyro, (turning, about_gimbal)) in self.0.iter().zip(forces) {
            *sum_b_n_m += turning + gyro.gimbal_axis_b.into_inner() * *about_gimbal;
        }
    }

    #[inline]
    fn rate(
        &self,
        state: &State,
        drive: &Drive,
        forces: &Forces,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
        to: &mut State,
    ) {
        for (j, gyro) in self.0.iter().enumerate() {
            to.angle_rad[j] = state.rate_rad_s[j];
            to.rate_rad_s[j] = if drive.is_free(j) {
                forces[j].1 / gyro.gimbal_inertia_kg_m2 - gyro.gimbal_axis_b.dot(omega_dot_wb_b_rad_s2)
            } else {
                0.0
            };
        }
    }

    fn set_out(&self, state: &State, drive: &mut Drive) {
        for j in 0..self.0.len() {
            self.set_sliding(state, drive, j, sign(state.rate_rad_s[j]));
        }
    }

    /// A gimbal that its bearing cannot hold slips, as a wheel does.
    #[inline]
    fn first_slip<'a>(
        &self,
        _effects: &EffectSet,
        environment: &dyn Fn() -> Environment<'a>,
        drive: &Drive,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> Option<(usize, f64)> {
        let held = |j: &usize| drive.stuck[*j] && !drive.along[*j];
        if !(0..self.0.len()).any(|j| held(&j)) {
            return None;
        }
        let omega_wb_b_rad_s = environment().omega_wb_b_rad_s;
        self.0.iter().enumerate().filter(|(j, _)| held(j)).find_map(|(j, gyro)| {
            let angle_rad = drive.held_rad[j];
            let across = gyro.axes_b(angle_rad).1 * gyro.rotor_momentum_n_m_s;
            let driven_n_m = gyro.motor_torque_n_m(drive.rate_rad_s[j], angle_rad, 0.0)
                + across.dot(&omega_wb_b_rad_s);
            let needed_n_m =
                gyro.gimbal_inertia_kg_m2 * gyro.gimbal_axis_b.dot(omega_dot_wb_b_rad_s2) - driven_n_m;
            (needed_n_m.abs() > gyro.coulomb_friction_n_m).then(|| (j, -sign(needed_n_m)))
        })
    }

    #[inline]
    fn first_stop(&self, from: &State, to: &State, drive: &Drive, h_s: f64) -> Option<(usize, f64)> {
        let parts = self.0.iter().enumerate().filter(|(j, _)| drive.is_free(*j));
        let under_friction = parts.filter(|(_, gyro)| gyro.coulomb_friction_n_m > 0.0);
        let sliding = under_friction.map(|(j, _)| Sliding {
            part: j,
            sense: drive.sliding[j],
            from: from.rate_rad_s[j],
            to: to.rate_rad_s[j],
        });
        Sliding::first_to_stop(sliding, h_s)
    }

    fn speed(&self, state: &State, gyro: usize) -> f64 {
        state.rate_rad_s.get(gyro).copied().unwrap_or(0.0)
    }

    fn slide(&self, state: &mut State, drive: &mut Drive, gyro: usize, sense: f64) {
        if sense == 0.0
            && let Some(rate) = state.rate_rad_s.get_mut(gyro)
        {
            *rate = 0.0;
        }
        self.set_sliding(state, drive, gyro, sense);
    }

    fn sample(
        &self,
        state: &State,
        drive: &Drive,
        _sensors: &SensorSuite,
        _noise: &mut dyn FnMut() -> f64,
    ) -> JointSample {
        let torque = |(j, gyro): (usize, &super::Gyro)| {
            gyro.motor_torque_n_m(drive.rate_rad_s[j], state.angle_rad[j], state.rate_rad_s[j])
        };
        let own = |values: &[f64]| values.iter().take(self.0.len()).copied().collect();
        JointSample {
            position_rad: own(&state.angle_rad),
            velocity_rad_s: own(&state.rate_rad_s),
            effort_n_m: self.0.iter().enumerate().map(torque).collect(),
        }
    }

    fn command(&self, drive: &mut Drive, rate_rad_s: &[f64]) {
        for ((slot, gyro), asked) in drive.rate_rad_s.iter_mut().zip(&self.0).zip(rate_rad_s) {
            *slot = asked.max(-gyro.max_rate_rad_s).min(gyro.max_rate_rad_s);
        }
    }
}

impl ControlMomentGyros {
    /// Sets the sense of sliding of a gimbal's bearing; 0 = stuck, if it has Coulomb friction.
    fn set_sliding(&self, state: &State, drive: &mut Drive, gyro: usize, sense: f64) {
        let has_friction = self.0.get(gyro).is_some_and(|g| g.coulomb_friction_n_m > 0.0);
        if gyro < MAX_GYROS {
            drive.sliding[gyro] = sense;
            drive.stuck[gyro] = has_friction && sense == 0.0;
            drive.held_rad[gyro] = state.angle_rad[gyro];
        }
    }
}
