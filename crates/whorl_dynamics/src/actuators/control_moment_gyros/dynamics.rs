//! Gimbals in motion.

use nalgebra::{Matrix3, Vector3};

use super::{ControlMomentGyros, MAX_GYROS};
use crate::effects::ThrustLag;
use crate::actuators::dynamics::{Instant, KindDynamics, OnBody};
use crate::platform::sensors::SensorSuite;
use crate::sensing::JointSample;

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
}

/// Of each gyro: torque with which the body turns its rotor h0 dgamma/dt t, body axes, and the torque about the gimbal
/// axis u + h0 t . w [N m].
pub(crate) type Forces = [(Vector3<f64>, f64); MAX_GYROS];

impl KindDynamics for ControlMomentGyros {
    type State = State;
    type Drive = Drive;
    type Forces = Forces;

    fn idle(&self, _lag: ThrustLag, _now_ns: i64) -> Drive {
        Drive { rate_rad_s: [0.0; MAX_GYROS] }
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
    fn add_momentum(&self, state: &State, sum_b_n_m_s: &mut Vector3<f64>) {
        for (j, gyro) in self.0.iter().enumerate() {
            *sum_b_n_m_s += gyro.axes_b(state.angle_rad[j]).0 * gyro.rotor_momentum_n_m_s
                + gyro.gimbal_axis_b.into_inner() * (gyro.gimbal_inertia_kg_m2 * state.rate_rad_s[j]);
        }
    }

    fn take_out(&self, _drive: Option<&Drive>, left: &mut Matrix3<f64>) {
        for gyro in &self.0 {
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
    ) -> Forces {
        let mut forces = [(Vector3::zeros(), 0.0); MAX_GYROS];
        for (j, gyro) in self.0.iter().enumerate() {
            let across = gyro.axes_b(state.angle_rad[j]).1 * gyro.rotor_momentum_n_m_s;
            let missing_rad_s = drive.rate_rad_s[j] - state.rate_rad_s[j];
            let motor_n_m = gyro.gimbal_inertia_kg_m2 * missing_rad_s / gyro.time_constant_s;
            forces[j] = (across * state.rate_rad_s[j], motor_n_m + across.dot(omega_wb_b_rad_s));
        }
        forces
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
        _drive: &Drive,
        forces: &Forces,
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> State {
        let mut rate = State { angle_rad: state.rate_rad_s, ..State::default() };
        for (j, gyro) in self.0.iter().enumerate() {
            rate.rate_rad_s[j] =
                forces[j].1 / gyro.gimbal_inertia_kg_m2 - gyro.gimbal_axis_b.dot(omega_dot_wb_b_rad_s2);
        }
        rate
    }

    fn sample(
        &self,
        state: &State,
        _drive: &Drive,
        _sensors: &SensorSuite,
        _noise: &mut dyn FnMut() -> f64,
    ) -> JointSample {
        let own = |values: &[f64]| values.iter().take(self.0.len()).copied().collect();
        JointSample {
            position_rad: own(&state.angle_rad),
            velocity_rad_s: own(&state.rate_rad_s),
            effort_n_m: Vec::new(),
        }
    }

    fn command(&self, drive: &mut Drive, rate_rad_s: &[f64]) {
        for ((slot, gyro), asked) in drive.rate_rad_s.iter_mut().zip(&self.0).zip(rate_rad_s) {
            *slot = asked.max(-gyro.max_rate_rad_s).min(gyro.max_rate_rad_s);
        }
    }
}
