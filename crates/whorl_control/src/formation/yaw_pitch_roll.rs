//! Attitude, rate and acceleration in yaw, pitch and roll: the coordinates in which a laboratory
//! platform's limits are simple.
//!
//! With `q_world_body = q_z(yaw) q_y(pitch) q_x(roll)` the rate in body axes is
//!
//! ```text
//! omega_x = roll'  - yaw' sin(pitch)
//! omega_y = pitch' cos(roll) + yaw' cos(pitch) sin(roll)
//! omega_z = yaw' cos(pitch) cos(roll) - pitch' sin(roll)
//! ```
//!
//! (H. Schaub, J. L. Junkins, *Analytical Mechanics of Space Systems*, 3-2-1 angles); the
//! acceleration is its time derivative, written out below. Singular at a pitch of 90 deg, which no
//! platform reaches: their pitch stops are at 30 deg or less.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::{EulerAngles, EulerSequence};

use crate::reference::Reference;

/// Below this cosine of pitch the inverse kinematics are not used: within 2.9 deg of the singularity.
const MIN_COS_PITCH: f64 = 0.05;

/// The 3-2-1 angles \[rad\]. As a vector: x = yaw, y = pitch, z = roll.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct YawPitchRoll {
    /// Turn about the world's vertical \[rad\].
    pub yaw_rad: f64,
    /// Turn about the new y axis, positive nose down (REP-103) \[rad\].
    pub pitch_rad: f64,
    /// Turn about the new x axis \[rad\].
    pub roll_rad: f64,
}

impl YawPitchRoll {
    /// The angles of an attitude: yaw and roll in `(-pi, pi]`, pitch in `[-pi/2, pi/2]`.
    #[must_use]
    pub fn of(q_world_body: &UnitQuaternion<f64>) -> Self {
        Self::from_vector(EulerAngles::from_quaternion(q_world_body, EulerSequence::E321).angles_rad)
    }

    /// The attitude.
    #[must_use]
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        EulerAngles { sequence: EulerSequence::E321, angles_rad: self.vector() }.to_quaternion()
    }

    /// `[yaw, pitch, roll]`.
    #[must_use]
    pub fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.yaw_rad, self.pitch_rad, self.roll_rad)
    }

    /// From `[yaw, pitch, roll]`.
    #[must_use]
    pub fn from_vector(angles_rad: Vector3<f64>) -> Self {
        Self { yaw_rad: angles_rad.x, pitch_rad: angles_rad.y, roll_rad: angles_rad.z }
    }
}

/// The angles with their first and second time derivatives, each as `[yaw, pitch, roll]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct YawPitchRollMotion {
    /// The angles \[rad\].
    pub angles: YawPitchRoll,
    /// Their rates \[rad/s\].
    pub rates_rad_s: Vector3<f64>,
    /// Their accelerations \[rad/s^2\].
    pub accelerations_rad_s2: Vector3<f64>,
}

impl YawPitchRollMotion {
    /// Standing still.
    #[must_use]
    pub fn at_rest(angles: YawPitchRoll) -> Self {
        Self { angles, rates_rad_s: Vector3::zeros(), accelerations_rad_s2: Vector3::zeros() }
    }

    /// The reference that moves so: exact, whatever the motion.
    #[must_use]
    pub fn reference(&self) -> Reference {
        let kinematics = Kinematics::at(&self.angles);
        let (rates, accelerations) = (&self.rates_rad_s, &self.accelerations_rad_s2);
        Reference {
            q_world_reference: self.angles.attitude(),
            omega_wr_r_rad_s: kinematics.body(rates),
            omega_dot_wr_r_rad_s2: kinematics.body(accelerations) + kinematics.coupling(rates),
        }
    }

    /// The motion of a reference in these coordinates. Near the singularity, where the angles have
    /// no rates, they are given as zero.
    #[must_use]
    pub fn of(reference: &Reference) -> Self {
        let angles = YawPitchRoll::of(&reference.q_world_reference);
        let kinematics = Kinematics::at(&angles);
        if kinematics.cos_pitch < MIN_COS_PITCH {
            return Self::at_rest(angles);
        }
        let rates_rad_s = kinematics.angle_rates(&reference.omega_wr_r_rad_s);
        let uncoupled = reference.omega_dot_wr_r_rad_s2 - kinematics.coupling(&rates_rad_s);
        Self { angles, rates_rad_s, accelerations_rad_s2: kinematics.angle_rates(&uncoupled) }
    }
}

struct Kinematics {
    sin_pitch: f64,
    cos_pitch: f64,
    sin_roll: f64,
    cos_roll: f64,
}

impl Kinematics {
    fn at(angles: &YawPitchRoll) -> Self {
        let ((sin_pitch, cos_pitch), (sin_roll, cos_roll)) =
            (angles.pitch_rad.sin_cos(), angles.roll_rad.sin_cos());
        Self { sin_pitch, cos_pitch, sin_roll, cos_roll }
    }

    /// Angle rates to body rates.
    fn body(&self, rates: &Vector3<f64>) -> Vector3<f64> {
        let (yaw, pitch, roll) = (rates.x, rates.y, rates.z);
        Vector3::new(
            roll - yaw * self.sin_pitch,
            pitch * self.cos_roll + yaw * self.cos_pitch * self.sin_roll,
            yaw * self.cos_pitch * self.cos_roll - pitch * self.sin_roll,
        )
    }

    /// Body rates to angle rates.
    fn angle_rates(&self, omega: &Vector3<f64>) -> Vector3<f64> {
        let yaw = (omega.y * self.sin_roll + omega.z * self.cos_roll) / self.cos_pitch;
        let pitch = omega.y * self.cos_roll - omega.z * self.sin_roll;
        Vector3::new(yaw, pitch, omega.x + yaw * self.sin_pitch)
    }

    /// The part of the body acceleration that comes from the angle rates alone.
    fn coupling(&self, rates: &Vector3<f64>) -> Vector3<f64> {
        let (yaw, pitch, roll) = (rates.x, rates.y, rates.z);
        Vector3::new(
            -yaw * pitch * self.cos_pitch,
            -pitch * roll * self.sin_roll
                + yaw * (roll * self.cos_pitch * self.cos_roll - pitch * self.sin_pitch * self.sin_roll),
            -pitch * roll * self.cos_roll
                - yaw * (pitch * self.sin_pitch * self.cos_roll + roll * self.cos_pitch * self.sin_roll),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use whorl_math::attitude_error;

    fn motion() -> impl Strategy<Value = YawPitchRollMotion> {
        let angles = (-3.0..3.0_f64, -1.2..1.2_f64, -3.0..3.0_f64);
        let three = |limit: f64| prop::array::uniform3(-limit..limit).prop_map(Vector3::from);
        (angles, three(0.5), three(0.3)).prop_map(|((yaw_rad, pitch_rad, roll_rad), rates, accelerations)| {
            YawPitchRollMotion {
                angles: YawPitchRoll { yaw_rad, pitch_rad, roll_rad },
                rates_rad_s: rates,
                accelerations_rad_s2: accelerations,
            }
        })
    }

    fn later(motion: &YawPitchRollMotion, dt_s: f64) -> YawPitchRollMotion {
        let angles = motion.angles.vector()
            + motion.rates_rad_s * dt_s
            + motion.accelerations_rad_s2 * (0.5 * dt_s * dt_s);
        YawPitchRollMotion {
            angles: YawPitchRoll::from_vector(angles),
            rates_rad_s: motion.rates_rad_s + motion.accelerations_rad_s2 * dt_s,
            accelerations_rad_s2: motion.accelerations_rad_s2,
        }
    }

    proptest! {
        #[test]
        fn rate_and_acceleration_are_the_derivatives(m in motion()) {
            let h = 1e-4;
            let (before, at, after) = (later(&m, -h).reference(), m.reference(), later(&m, h).reference());
            let rate = attitude_error(&before.q_world_reference, &after.q_world_reference) / (2.0 * h);
            // The rotation vector over the interval is in axes that agree with the middle's to first order.
            prop_assert!((rate - at.omega_wr_r_rad_s).norm() < 1e-7, "{rate} {}", at.omega_wr_r_rad_s);
            let acceleration = (after.omega_wr_r_rad_s - before.omega_wr_r_rad_s) / (2.0 * h);
            prop_assert!((acceleration - at.omega_dot_wr_r_rad_s2).norm() < 1e-7);
        }

        #[test]
        fn motion_survives_the_round_trip(m in motion()) {
            let back = YawPitchRollMotion::of(&m.reference());
            prop_assert!((back.angles.vector() - m.angles.vector()).norm() < 1e-10);
            prop_assert!((back.rates_rad_s - m.rates_rad_s).norm() < 1e-10);
            prop_assert!((back.accelerations_rad_s2 - m.accelerations_rad_s2).norm() < 1e-10);
        }
    }

    #[test]
    fn at_the_singularity_the_rates_are_zero_not_infinite() {
        let up = YawPitchRoll { yaw_rad: 0.3, pitch_rad: std::f64::consts::FRAC_PI_2, roll_rad: 0.0 };
        let moving =
            Reference { omega_wr_r_rad_s: Vector3::new(0.1, 0.2, 0.3), ..Reference::at_rest(up.attitude()) };
        assert_eq!(YawPitchRollMotion::of(&moving).rates_rad_s, Vector3::zeros());
    }
}
