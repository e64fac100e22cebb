//! A rest-to-rest manoeuvre between two attitudes, inside the bearing's freedom.
//!
//! The shortest way is a rotation about the eigenaxis of the difference (B. Wie, *Space Vehicle
//! Dynamics and Control*, 2nd ed., AIAA 2008, section 7.3). On a bearing that way may leave the
//! freedom although both ends are inside: two attitudes with 4 deg of lean and half a turn of yaw
//! between them can be joined by an arc through 6 deg. Then the path goes straight in the coordinates
//! in which the freedom is convex: for a tabletop the lean (a horizontal rotation vector in the world)
//! and the yaw, for a dumbbell yaw, pitch and roll.
//!
//! Along the path moves a [`SmoothTrapezoid`].

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_dynamics::platform::TiltLimit;
use whorl_math::{
    azimuth_rad, elevation_x_rad, quaternion_exp, right_jacobian, roll_rad, rotation_vector, wrap_angle_rad,
};

use super::{Reference, SmoothTrapezoid, TiltEnvelope};

/// Points at which a path is examined.
const SAMPLES: u32 = 64;
/// Step of the central difference along the path (length 1); its error is of order 1e-8.
const PATH_STEP: f64 = 1e-4;
/// Share of the acceleration limit that the curvature of a path may take.
const CURVATURE_SHARE: f64 = 0.3;

/// Limits of a slew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlewLimits {
    max_rate_rad_s: f64,
    max_acceleration_rad_s2: f64,
}

/// Limits that are not positive and finite.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error(
    "slew limits {max_rate_rad_s} rad/s and {max_acceleration_rad_s2} rad/s^2 must be positive and finite"
)]
pub struct SlewLimitsError {
    /// The rate given.
    pub max_rate_rad_s: f64,
    /// The acceleration given.
    pub max_acceleration_rad_s2: f64,
}

impl SlewLimits {
    /// Checked constructor.
    ///
    /// # Errors
    /// [`SlewLimitsError`] unless both are positive and finite.
    pub fn new(max_rate_rad_s: f64, max_acceleration_rad_s2: f64) -> Result<Self, SlewLimitsError> {
        let valid = |x: f64| x > 0.0 && x.is_finite();
        if valid(max_rate_rad_s) && valid(max_acceleration_rad_s2) {
            Ok(Self { max_rate_rad_s, max_acceleration_rad_s2 })
        } else {
            Err(SlewLimitsError { max_rate_rad_s, max_acceleration_rad_s2 })
        }
    }

    /// Largest body rate \[rad/s\].
    #[must_use]
    pub fn max_rate_rad_s(&self) -> f64 {
        self.max_rate_rad_s
    }

    /// Largest angular acceleration \[rad/s^2\].
    #[must_use]
    pub fn max_acceleration_rad_s2(&self) -> f64 {
        self.max_acceleration_rad_s2
    }
}

/// A planned manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slew {
    path: Path,
    profile: SmoothTrapezoid,
    end: UnitQuaternion<f64>,
    clipped: bool,
}

impl Slew {
    /// Plans the manoeuvre from rest at `q_from` to rest at `q_to`, clipped into the envelope.
    ///
    /// A start outside the envelope is kept (a reference must not jump); the path then leads inwards.
    #[must_use]
    pub fn new(
        q_from: &UnitQuaternion<f64>,
        q_to: &UnitQuaternion<f64>,
        limits: &SlewLimits,
        envelope: &TiltEnvelope,
    ) -> Self {
        let (end, clipped) = envelope.clip(q_to);
        let direct = Path::eigenaxis(q_from, &end);
        let allowed_rad = envelope.max_rad().max(envelope.angle_rad(q_from)) + 1e-9;
        let inside = samples().all(|s| envelope.angle_rad(&direct.attitude(s)) <= allowed_rad);
        let path = if inside { direct } else { Path::separate(q_from, &end, envelope.limit()) };

        let (mut rate, mut curvature) = (0.0_f64, 0.0_f64);
        for s in samples() {
            rate = rate.max(path.rate_per_length(s).norm());
            curvature = curvature.max(path.rate_slope_per_length(s).norm());
        }
        // |omega_dot| <= rate * s_ddot + curvature * s_dot^2.
        let (max_rate, max_acceleration) = (limits.max_rate_rad_s, limits.max_acceleration_rad_s2);
        let profile = if rate < 1e-12 {
            SmoothTrapezoid::new(0.0, 1.0, 1.0)
        } else if curvature < 1e-9 * rate {
            SmoothTrapezoid::new(1.0, max_rate / rate, max_acceleration / rate)
        } else {
            let curve_limit_s = (CURVATURE_SHARE * max_acceleration / curvature).sqrt();
            SmoothTrapezoid::new(
                1.0,
                (max_rate / rate).min(curve_limit_s),
                (1.0 - CURVATURE_SHARE) * max_acceleration / rate,
            )
        };
        Self { path, profile, end, clipped }
    }

    /// From rest to rest \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.profile.duration_s()
    }

    /// Where it ends: the asked attitude, clipped into the envelope.
    #[must_use]
    pub fn end(&self) -> UnitQuaternion<f64> {
        self.end
    }

    /// Whether the asked attitude was outside the envelope.
    #[must_use]
    pub fn clipped(&self) -> bool {
        self.clipped
    }

    /// The reference `elapsed_s` after the start; at rest before and after.
    #[must_use]
    pub fn at(&self, elapsed_s: f64) -> Reference {
        if elapsed_s >= self.duration_s() {
            return Reference::at_rest(self.end);
        }
        let p = self.profile.at(elapsed_s);
        let rate_per_length = self.path.rate_per_length(p.position);
        Reference {
            q_world_reference: self.path.attitude(p.position),
            omega_wr_r_rad_s: rate_per_length * p.rate_s,
            omega_dot_wr_r_rad_s2: rate_per_length * p.acceleration_s2
                + self.path.rate_slope_per_length(p.position) * (p.rate_s * p.rate_s),
        }
    }
}

fn samples() -> impl Iterator<Item = f64> {
    (0..=SAMPLES).map(|k| f64::from(k) / f64::from(SAMPLES))
}

/// A curve of attitudes over a length from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Path {
    /// `q = start * exp(s * rotation)`.
    Eigenaxis { start: UnitQuaternion<f64>, rotation_rad: Vector3<f64> },
    /// `q = exp(lean) * R_z(yaw)`, both linear in s; `lean` is horizontal.
    LeanAndYaw { lean_rad: [Vector3<f64>; 2], yaw_rad: [f64; 2] },
    /// `q = R_z(yaw) R_y(pitch) R_x(roll)`, all linear in s; each as `[start, difference]`.
    YawPitchRoll { yaw_rad: [f64; 2], pitch_rad: [f64; 2], roll_rad: [f64; 2] },
}

impl Path {
    fn eigenaxis(q_from: &UnitQuaternion<f64>, q_to: &UnitQuaternion<f64>) -> Self {
        Self::Eigenaxis { start: *q_from, rotation_rad: rotation_vector(&(q_from.inverse() * q_to)) }
    }

    fn separate(q_from: &UnitQuaternion<f64>, q_to: &UnitQuaternion<f64>, limit: TiltLimit) -> Self {
        let turn = |from: f64, to: f64| [from, wrap_angle_rad(to - from)];
        match limit {
            TiltLimit::Cone { .. } => {
                let (lean_from, yaw_from) = lean_and_yaw(q_from);
                let (lean_to, yaw_to) = lean_and_yaw(q_to);
                Self::LeanAndYaw {
                    lean_rad: [lean_from, lean_to - lean_from],
                    yaw_rad: turn(yaw_from, yaw_to),
                }
            }
            TiltLimit::Pitch { .. } => Self::YawPitchRoll {
                yaw_rad: turn(azimuth_rad(q_from), azimuth_rad(q_to)),
                // REP-103: pitch is positive nose down.
                pitch_rad: turn(-elevation_x_rad(q_from), -elevation_x_rad(q_to)),
                roll_rad: turn(roll_rad(q_from), roll_rad(q_to)),
            },
        }
    }

    fn attitude(&self, s: f64) -> UnitQuaternion<f64> {
        match self {
            Self::Eigenaxis { start, rotation_rad } => start * quaternion_exp(&(rotation_rad * s)),
            Self::LeanAndYaw { lean_rad: [lean, d_lean], yaw_rad: [yaw, d_yaw] } => {
                quaternion_exp(&(lean + d_lean * s)) * about_z(yaw + d_yaw * s)
            }
            Self::YawPitchRoll {
                yaw_rad: [yaw, d_yaw],
                pitch_rad: [pitch, d_pitch],
                roll_rad: [roll, d_roll],
            } => UnitQuaternion::from_euler_angles(roll + d_roll * s, pitch + d_pitch * s, yaw + d_yaw * s),
        }
    }

    /// Body rate per unit of s_dot \[rad\], in body axes.
    fn rate_per_length(&self, s: f64) -> Vector3<f64> {
        match self {
            Self::Eigenaxis { rotation_rad, .. } => *rotation_rad,
            Self::LeanAndYaw { lean_rad: [lean, d_lean], yaw_rad: [yaw, d_yaw] } => {
                let of_lean = right_jacobian(&(lean + d_lean * s)) * d_lean;
                about_z(yaw + d_yaw * s).inverse() * of_lean + Vector3::z() * *d_yaw
            }
            // The rates of the 3-2-1 sequence, e.g. Wie (2008), eq. (5.72).
            Self::YawPitchRoll {
                yaw_rad: [_, d_yaw],
                pitch_rad: [pitch, d_pitch],
                roll_rad: [roll, d_roll],
            } => {
                let (sin_pitch, cos_pitch) = (pitch + d_pitch * s).sin_cos();
                let (sin_roll, cos_roll) = (roll + d_roll * s).sin_cos();
                Vector3::new(
                    d_roll - d_yaw * sin_pitch,
                    d_pitch * cos_roll + d_yaw * cos_pitch * sin_roll,
                    d_yaw * cos_pitch * cos_roll - d_pitch * sin_roll,
                )
            }
        }
    }

    /// Derivative of [`Self::rate_per_length`] by s \[rad\].
    fn rate_slope_per_length(&self, s: f64) -> Vector3<f64> {
        match self {
            Self::Eigenaxis { .. } => Vector3::zeros(),
            _ => {
                (self.rate_per_length(s + PATH_STEP) - self.rate_per_length(s - PATH_STEP))
                    / (2.0 * PATH_STEP)
            }
        }
    }
}

fn about_z(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

/// `q = exp(lean) * R_z(yaw)` with `lean` horizontal in the world.
fn lean_and_yaw(q: &UnitQuaternion<f64>) -> (Vector3<f64>, f64) {
    let up = Vector3::z();
    let z_w = q * up;
    let axis = up.cross(&z_w);
    let sine = axis.norm();
    // At rest on the pole the axis does not matter; the angle is zero (or half a turn).
    let lean = if sine > 1e-12 { axis * (sine.atan2(z_w.z) / sine) } else { Vector3::zeros() };
    let twist = quaternion_exp(&lean).inverse() * q;
    (lean, wrap_angle_rad(2.0 * twist.k.atan2(twist.w)))
}

#[cfg(test)]
mod tests {
    use super::super::tilt::tests::{dumbbell, tabletop};
    use super::*;
    use whorl_math::attitude_error;

    fn limits() -> SlewLimits {
        SlewLimits::new(0.1, 0.05).unwrap()
    }

    fn leaning(towards_rad: f64, tilt_rad: f64, yaw_rad: f64) -> UnitQuaternion<f64> {
        quaternion_exp(&(Vector3::new(towards_rad.cos(), towards_rad.sin(), 0.0) * tilt_rad))
            * about_z(yaw_rad)
    }

    /// Rate and acceleration are the derivatives of attitude and rate, limits hold, tilt stays inside.
    fn check(slew: &Slew, envelope: &TiltEnvelope) {
        let steps = 4000;
        let dt = slew.duration_s() / f64::from(steps);
        for k in 1..steps {
            let t = f64::from(k) * dt;
            let (before, here, after) = (slew.at(t - 0.5 * dt), slew.at(t), slew.at(t + 0.5 * dt));
            let rate = attitude_error(&before.q_world_reference, &after.q_world_reference) / dt;
            assert!((rate - here.omega_wr_r_rad_s).norm() < 1e-5, "rate at {t}");
            let slope = (after.omega_wr_r_rad_s - before.omega_wr_r_rad_s) / dt;
            assert!((slope - here.omega_dot_wr_r_rad_s2).norm() < 2e-4, "acceleration at {t}");
            assert!(here.omega_wr_r_rad_s.norm() <= 0.1 + 1e-9);
            assert!(here.omega_dot_wr_r_rad_s2.norm() <= 0.05 + 1e-9);
            assert!(envelope.angle_rad(&here.q_world_reference) <= envelope.max_rad() + 1e-6, "tilt at {t}");
        }
    }

    #[test]
    fn plain_yaw_slew_is_the_eigenaxis_one_and_time_optimal_for_its_profile() {
        let slew = Slew::new(&about_z(0.2), &about_z(1.2), &limits(), &tabletop());
        // 1 rad at 0.1 rad/s and 0.05 rad/s^2: ramps of 3 s cover 0.3 rad, cruise 7 s.
        assert!((slew.duration_s() - 13.0).abs() < 1e-9);
        check(&slew, &tabletop());
        let middle = slew.at(6.5);
        assert!(middle.q_world_reference.angle_to(&about_z(0.7)) < 1e-7);
        assert!((middle.omega_wr_r_rad_s - Vector3::z() * 0.1).norm() < 1e-12);
        assert_eq!(slew.at(99.0), Reference::at_rest(about_z(1.2)));
    }

    #[test]
    fn a_slew_whose_eigenaxis_way_leaves_the_cone_takes_another() {
        let (from, to) = (leaning(0.0, 0.069, 0.0), leaning(1.57, 0.069, 3.0));
        let straight = Path::eigenaxis(&from, &to);
        assert!(samples().any(|s| !tabletop().contains(&straight.attitude(s))), "the case is a case");
        let slew = Slew::new(&from, &to, &limits(), &tabletop());
        assert!(!slew.clipped());
        check(&slew, &tabletop());
        assert!(slew.at(0.0).q_world_reference.angle_to(&from) < 1e-7);
        assert!(slew.path.attitude(1.0).angle_to(&to) < 1e-7);
    }

    #[test]
    fn a_dumbbell_slew_with_large_roll_and_yaw_keeps_its_pitch() {
        let from = UnitQuaternion::from_euler_angles(0.0, 0.4, 0.0);
        let to = UnitQuaternion::from_euler_angles(2.5, 0.45, 2.9);
        let slew = Slew::new(&from, &to, &limits(), &dumbbell());
        assert!(matches!(slew.path, Path::YawPitchRoll { .. }));
        check(&slew, &dumbbell());
        assert!(slew.path.attitude(1.0).angle_to(&to) < 1e-7);
    }

    #[test]
    fn an_end_outside_is_clipped_and_said_so() {
        let slew = Slew::new(&UnitQuaternion::identity(), &leaning(0.3, 0.3, 0.5), &limits(), &tabletop());
        assert!(slew.clipped());
        assert!((tabletop().angle_rad(&slew.end()) - tabletop().max_rad()).abs() < 1e-9);
        check(&slew, &tabletop());
    }

    #[test]
    fn going_nowhere_takes_no_time() {
        let q = leaning(0.4, 0.03, 1.0);
        let slew = Slew::new(&q, &q, &limits(), &tabletop());
        assert_eq!(slew.duration_s(), 0.0);
        assert_eq!(slew.at(0.0).omega_wr_r_rad_s, Vector3::zeros());
    }

    #[test]
    fn limits_must_be_positive() {
        for (rate, acceleration) in [(0.0, 1.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert!(SlewLimits::new(rate, acceleration).is_err());
        }
    }
}
