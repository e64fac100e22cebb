//! Quaternion tracking law for a gyrostat.
//!
//! # Equation
//!
//! With wheels of spin inertia `I_j` about axes `a_j`, the motion about the centre of rotation is
//! (Schwartz 2004, eqs. 4.8-4.14 and 4.81)
//!
//! ```text
//! J omega_dot = tau - omega x (I omega + h_w) + g,      J = I - sum_j I_j a_j a_j^T,
//! ```
//!
//! `I` the total inertia with wheels locked, `h_w = sum_j I_j Omega_j a_j` the wheels' momentum
//! relative to the body, `tau` the control torque (jets, and minus the net torque on each wheel along its
//! axis), `g` all other torques. With `q_e = q_ref^-1 q_body = [q_0, q_v]`, `R = R(q_e)^T` from
//! reference to body axes and `omega_e = omega - R omega_r` the law is
//!
//! ```text
//! tau = J ( -W^2 (2 sgn(q_0) q_v + z/T_i) - 2 Z W omega_e )        feedback
//!     + omega x (I omega + h_w)                                    gyroscopic
//!     + J (R omega_dot_r - omega x R omega_r)                      inertia
//!     - g_model                                                    modelled torques
//! ```
//!
//! `W` and `Z` diagonal (bandwidth and damping per body axis), `z` the clamped integral of
//! `2 sgn(q_0) q_v`. Sources: B. Wie, H. Weiss, A. Arapostathis, "Quaternion feedback regulator for
//! spacecraft eigenaxis rotations", J. Guidance 12(3), 1989 (gains scaled by the inertia); J. T.-Y. Wen,
//! K. Kreutz-Delgado, "The attitude control problem", IEEE Trans. Automatic Control 36(10), 1991
//! (tracking with feed-forward).
//!
//! # Stability
//!
//! Substituted, and without integral action and saturation, the error obeys
//! `omega_e_dot = -2 W^2 sgn(q_0) q_v - 2 Z W omega_e` whatever the reference does. Take
//! `V = 1/2 omega_e^T W^-2 omega_e + 4 (1 - |q_0|)`, zero only at `q_e = +-1, omega_e = 0`. With
//! `d|q_0|/dt = -1/2 sgn(q_0) q_v . omega_e`
//!
//! ```text
//! V_dot = omega_e^T W^-2 omega_e_dot + 2 sgn(q_0) q_v . omega_e = -2 omega_e^T W^-1 Z omega_e <= 0
//! ```
//!
//! and LaSalle's theorem leaves only `q_e = +-1`. Both signs of
//! `q_e` are the same attitude, so there is no unwinding; at exactly half a turn the sign is held with
//! hysteresis (C. G. Mayhew, R. G. Sanfelice, A. R. Teel, IEEE Trans. Automatic Control 56(11),
//! 2011) and noise cannot make it chatter. Near the reference the axes decouple into
//! `e'' + 2 Z W e' + W^2 e = 0`; with integral action the characteristic polynomial
//! `s^3 + 2 Z W s^2 + W^2 s + W^2/T_i` is stable exactly when `T_i > 1/(2 Z W)` (Routh), which
//! [`TrackingLaw::new`] demands.
//!
//! An inertia error of relative size `d` acts like a gain error of the same size: the law tolerates
//! tens of percent. The optional low-pass of the rate error (for jets, whose valves would answer every
//! gyro sample) adds a lag; keep its time constant below `1/(5 W)`.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_dynamics::actuators::Actuators;
use whorl_dynamics::gyrostat::RateEquation;
use whorl_math::attitude_error;

use crate::reference::Reference;

/// Half-width of the hysteresis in the scalar part of the error quaternion: 0.1 is 11.5 deg of
/// rotation about half a turn.
const SIGN_HYSTERESIS: f64 = 0.1;

/// Gains of the law, as a user thinks of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingGains {
    /// Natural frequency of the error about each body axis \[rad/s\], > 0.
    pub bandwidth_rad_s: Vector3<f64>,
    /// Damping ratio about each body axis, > 0.
    pub damping: Vector3<f64>,
    /// Integral action, if any.
    pub integral: Option<IntegralAction>,
    /// Time constant of a first-order low-pass on the rate error \[s\], >= 0; 0 = none.
    pub rate_error_time_constant_s: f64,
}

/// Integral action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntegralAction {
    /// Integral time T_i \[s\], > 1/(2 Z W) on every axis.
    pub time_s: f64,
    /// Largest torque it may contribute about each body axis \[N m\], >= 0.
    pub limit_n_m: Vector3<f64>,
    /// It integrates only while the attitude error is smaller than this \[rad\], > 0: large errors
    /// belong to transients.
    pub zone_rad: f64,
}

/// Why gains were refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TrackingError {
    /// A gain is outside its range.
    #[error("{field} = {value}: must be {allowed}")]
    Gain {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed, in words.
        allowed: &'static str,
    },
    /// Integral action too fast for the loop to be stable.
    #[error(
        "integral time {time_s} s is unstable: it must exceed 1/(2 damping bandwidth) = {bound_s} s on every axis"
    )]
    IntegralTime {
        /// The time given.
        time_s: f64,
        /// The bound.
        bound_s: f64,
    },
    /// The inertia is not positive definite once that of the moving parts (wheels' spin inertia) is subtracted.
    #[error("inertia less the wheels' spin inertia is not positive definite")]
    Inertia,
}

/// Inputs of the law at one instant.
#[derive(Debug, Clone, Copy)]
pub struct TrackingInput<'a> {
    /// Attitude of the body.
    pub q_world_body: &'a UnitQuaternion<f64>,
    /// Body rate, body axes \[rad/s\].
    pub omega_wb_b_rad_s: &'a Vector3<f64>,
    /// The reference at the same instant.
    pub reference: &'a Reference,
    /// Momentum of the wheels relative to the body, body axes \[N m s\].
    pub wheel_momentum_b_n_m_s: &'a Vector3<f64>,
    /// Known torque on the body besides the actuators', body axes \[N m\].
    pub modelled_torque_b_n_m: &'a Vector3<f64>,
    /// Time since the previous step \[s\]; only the rate error's low-pass needs it.
    pub dt_s: f64,
}

/// The torque demanded by the law, and the errors that it is based on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingOutput {
    /// Torque on the body, body axes \[N m\].
    pub torque_b_n_m: Vector3<f64>,
    /// Rotation vector from reference to body, body axes \[rad\].
    pub attitude_error_b_rad: Vector3<f64>,
    /// Body rate less reference rate, body axes \[rad/s\].
    pub rate_error_b_rad_s: Vector3<f64>,
}

/// The law with its integral.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingLaw {
    equation: RateEquation,
    gains: TrackingGains,
    /// Torque that the integral contributes, body axes [N m].
    integral_b_n_m: Vector3<f64>,
    /// sgn(q_0) with hysteresis.
    sign: f64,
    /// 2 sgn(q_0) q_v of the latest step [rad].
    error: Vector3<f64>,
    /// Low-passed rate error [rad/s]; none before the first step.
    filtered_rate_error: Option<Vector3<f64>>,
}

impl TrackingLaw {
    /// Checked constructor, for a platform of this inertia about the centre of rotation (wheels locked, body axes
    /// [kg m^2]) with these actuators: what their motors turn does not resist.
    ///
    /// # Errors
    /// [`TrackingError`] naming the first gain that is out of range, an unstable integral time, or that the inertia
    /// less that of the moving parts is not positive definite.
    pub fn new(
        inertia_b_kg_m2: Matrix3<f64>,
        actuators: &Actuators,
        gains: TrackingGains,
    ) -> Result<Self, TrackingError> {
        check_gains(&gains)?;
        let equation =
            RateEquation::with_free_parts(inertia_b_kg_m2, actuators).ok_or(TrackingError::Inertia)?;
        Ok(Self {
            equation,
            gains,
            integral_b_n_m: Vector3::zeros(),
            sign: 1.0,
            error: Vector3::zeros(),
            filtered_rate_error: None,
        })
    }

    /// Forgets integral and filter: at the start of tracking.
    pub fn reset(&mut self) {
        self.integral_b_n_m = Vector3::zeros();
        self.error = Vector3::zeros();
        self.sign = 1.0;
        self.filtered_rate_error = None;
    }

    /// The equation of motion that it counts on.
    #[must_use]
    pub fn equation(&self) -> &RateEquation {
        &self.equation
    }

    /// The torque that the integral contributes, body axes \[N m\].
    #[must_use]
    pub fn integral_b_n_m(&self) -> Vector3<f64> {
        self.integral_b_n_m
    }

    /// Takes over the integral of a law with other gains, clamped to this one's limits. It is a
    /// torque, so nothing jumps.
    pub fn restore_integral(&mut self, integral_b_n_m: Vector3<f64>) {
        self.integral_b_n_m = match &self.gains.integral {
            Some(integral) => integral_b_n_m.zip_map(&integral.limit_n_m, |v, limit| v.clamp(-limit, limit)),
            None => Vector3::zeros(),
        };
    }

    /// The torque to ask of the actuators.
    pub fn torque(&mut self, input: &TrackingInput<'_>) -> TrackingOutput {
        let (omega, reference) = (input.omega_wb_b_rad_s, input.reference);
        let q_error = reference.q_world_reference.inverse() * input.q_world_body;
        // The sign is only given up when the other one is clearly the shorter way.
        if self.sign * q_error.w < -SIGN_HYSTERESIS {
            self.sign = -self.sign;
        }
        self.error = q_error.imag() * (2.0 * self.sign);

        let to_body = q_error.inverse();
        let omega_reference_b = to_body * reference.omega_wr_r_rad_s;
        let rate_error = omega - omega_reference_b;
        let (bandwidth, damping) = (self.gains.bandwidth_rad_s, self.gains.damping);
        let damped_rate = self.low_pass(rate_error, input.dt_s);
        let feedback = -bandwidth.component_mul(&bandwidth.component_mul(&self.error))
            - bandwidth.component_mul(&damping.component_mul(&damped_rate)) * 2.0;
        let reference_acceleration =
            to_body * reference.omega_dot_wr_r_rad_s2 - omega.cross(&omega_reference_b);
        let momentum = self.equation.momentum_b_n_m_s(omega, input.wheel_momentum_b_n_m_s);
        let acceleration = feedback + reference_acceleration;

        TrackingOutput {
            torque_b_n_m: self.equation.required_torque_b_n_m(omega, &momentum, &acceleration)
                + self.integral_b_n_m
                - input.modelled_torque_b_n_m,
            attitude_error_b_rad: attitude_error(&reference.q_world_reference, input.q_world_body),
            rate_error_b_rad_s: rate_error,
        }
    }

    fn low_pass(&mut self, rate_error: Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        let time_constant_s = self.gains.rate_error_time_constant_s;
        let filtered = match self.filtered_rate_error {
            Some(previous) if time_constant_s > 0.0 => {
                previous + (rate_error - previous) * (1.0 - (-dt_s.max(0.0) / time_constant_s).exp())
            }
            _ => rate_error,
        };
        self.filtered_rate_error = Some(filtered);
        filtered
    }

    /// Moves the integral on by `dt_s` after the torque of [`Self::torque`] was allocated.
    ///
    /// Anti-windup: nothing is integrated while the actuators could not give the whole torque
    /// (`attained` false) or the error is outside the zone; the contribution is clamped per axis.
    pub fn integrate(&mut self, dt_s: f64, attained: bool) {
        let Some(integral) = self.gains.integral else { return };
        if !attained || dt_s.is_nan() || dt_s <= 0.0 || self.error.norm() > integral.zone_rad {
            return;
        }
        let bandwidth = &self.gains.bandwidth_rad_s;
        let acceleration_rate =
            -bandwidth.component_mul(&bandwidth.component_mul(&self.error)) / integral.time_s;
        let next = self.integral_b_n_m + self.equation.resisting_b_kg_m2() * acceleration_rate * dt_s;
        self.integral_b_n_m = next.zip_map(&integral.limit_n_m, |value, limit| value.clamp(-limit, limit));
    }
}

fn check_gains(gains: &TrackingGains) -> Result<(), TrackingError> {
    let check = |field, value: f64, valid: bool, allowed| {
        if valid && value.is_finite() { Ok(()) } else { Err(TrackingError::Gain { field, value, allowed }) }
    };
    let filter_s = gains.rate_error_time_constant_s;
    check("rate_error_time_constant_s", filter_s, filter_s >= 0.0, "finite and >= 0")?;
    for axis in 0..3 {
        let (bandwidth, damping) = (gains.bandwidth_rad_s[axis], gains.damping[axis]);
        check("bandwidth_rad_s", bandwidth, bandwidth > 0.0, "finite and > 0")?;
        check("damping", damping, damping > 0.0, "finite and > 0")?;
        if let Some(integral) = &gains.integral {
            let limit = integral.limit_n_m[axis];
            check("integral limit_n_m", limit, limit >= 0.0, "finite and >= 0")?;
            check("integral time_s", integral.time_s, integral.time_s > 0.0, "finite and > 0")?;
            check("integral zone_rad", integral.zone_rad, integral.zone_rad > 0.0, "finite and > 0")?;
            let bound_s = 1.0 / (2.0 * damping * bandwidth);
            if integral.time_s <= bound_s {
                return Err(TrackingError::IntegralTime { time_s: integral.time_s, bound_s });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
