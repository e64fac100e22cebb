//! Euler angles: all twelve sequences and their rate matrices.
//!
//! A sequence `i-j-k` turns the frame about its axis i, then about its new axis j, then
//! about its new axis k, so that `q_world_body = q_i(a1) q_j(a2) q_k(a3)` (active). Extraction
//! from the quaternion follows E. Bernardes and S. Viollet, "Quaternion to Euler angles
//! conversion: A direct, general and computationally efficient method", PLoS ONE 17(11),
//! 2022, rederived for our product order.

use crate::{deg_from_rad, skew, wrap_angle_rad};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::fmt;

/// Within this of a singular second angle, first and third angle cannot be separated.
const GIMBAL_LOCK_RAD: f64 = 1e-9;

/// The twelve sequences. `E321` (yaw, pitch, roll) is REP-103's; `E313` is the classic orbital one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EulerSequence {
    /// x, y, z.
    E123,
    /// x, z, y.
    E132,
    /// y, x, z.
    E213,
    /// y, z, x.
    E231,
    /// z, x, y.
    E312,
    /// z, y, x: yaw, pitch, roll.
    E321,
    /// x, y, x.
    E121,
    /// x, z, x.
    E131,
    /// y, x, y.
    E212,
    /// y, z, y.
    E232,
    /// z, x, z.
    E313,
    /// z, y, z.
    E323,
}

impl EulerSequence {
    /// Every sequence.
    pub const ALL: [Self; 12] = [
        Self::E123,
        Self::E132,
        Self::E213,
        Self::E231,
        Self::E312,
        Self::E321,
        Self::E121,
        Self::E131,
        Self::E212,
        Self::E232,
        Self::E313,
        Self::E323,
    ];

    /// First, second and remaining axis (0, 1, 2), and whether the third turn is about the first axis.
    fn axes(self) -> (usize, usize, usize, bool) {
        match self {
            Self::E123 => (0, 1, 2, false),
            Self::E132 => (0, 2, 1, false),
            Self::E213 => (1, 0, 2, false),
            Self::E231 => (1, 2, 0, false),
            Self::E312 => (2, 0, 1, false),
            Self::E321 => (2, 1, 0, false),
            Self::E121 => (0, 1, 2, true),
            Self::E131 => (0, 2, 1, true),
            Self::E212 => (1, 0, 2, true),
            Self::E232 => (1, 2, 0, true),
            Self::E313 => (2, 0, 1, true),
            Self::E323 => (2, 1, 0, true),
        }
    }

    /// The three axes of rotation as unit vectors.
    fn unit_axes(self) -> [nalgebra::Unit<Vector3<f64>>; 3] {
        let of = |axis: usize| match axis {
            0 => Vector3::x_axis(),
            1 => Vector3::y_axis(),
            _ => Vector3::z_axis(),
        };
        let (first, second, other, proper) = self.axes();
        [of(first), of(second), of(if proper { first } else { other })]
    }
}

/// Euler angles of `q_world_body` in a stated sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EulerAngles {
    /// The sequence of axes.
    pub sequence: EulerSequence,
    /// The angles in the order of the sequence \[rad\].
    pub angles_rad: Vector3<f64>,
}

/// The second angle is where the sequence is singular: no finite angle rates exist.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GimbalLock {
    /// The sequence.
    pub sequence: EulerSequence,
    /// The second angle \[rad\].
    pub second_angle_rad: f64,
}

impl fmt::Display for GimbalLock {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "sequence {:?} is singular at its second angle of {:.6} deg: choose another sequence",
            self.sequence,
            deg_from_rad(self.second_angle_rad)
        )
    }
}

impl std::error::Error for GimbalLock {}

impl EulerAngles {
    /// The angles of an attitude: first and third in `(-pi, pi]`, second in `[-pi/2, pi/2]` for
    /// three different axes and in `[0, pi]` where the first axis repeats.
    ///
    /// At the singular second angle only the sum or the difference of the outer angles exists:
    /// the third is then zero, and the angles still reproduce the attitude.
    #[must_use]
    pub fn from_quaternion(q_world_body: &UnitQuaternion<f64>, sequence: EulerSequence) -> Self {
        let (first, second, other, proper) = sequence.axes();
        let handed = handedness(first, second);
        let vector = q_world_body.imag();
        let component = |axis: usize| match axis {
            0 => vector.x,
            1 => vector.y,
            _ => vector.z,
        };
        let (w, x, y, z) = (q_world_body.w, component(first), component(second), component(other));
        // Three different axes: q (1 + e_second) is a repeated-axis rotation whose second
        // angle is larger by 90 degrees.
        let (a, b, c, d) =
            if proper { (w, x, y, handed * z) } else { (w - y, x - handed * z, y + w, x + handed * z) };
        let (inner, outer) = (a.hypot(b), c.hypot(d));
        let second_angle = 2.0 * outer.atan2(inner);
        let (half_sum, half_difference) = (b.atan2(a), d.atan2(c));
        let scale = inner.hypot(outer);
        let (angle_1, angle_3) = if outer <= 0.5 * GIMBAL_LOCK_RAD * scale {
            (2.0 * half_sum, 0.0)
        } else if inner <= 0.5 * GIMBAL_LOCK_RAD * scale {
            (2.0 * half_difference, 0.0)
        } else {
            (half_sum + half_difference, half_sum - half_difference)
        };
        let (angle_2, angle_3) =
            if proper { (second_angle, angle_3) } else { (second_angle - FRAC_PI_2, -handed * angle_3) };
        Self { sequence, angles_rad: Vector3::new(wrap_angle_rad(angle_1), angle_2, wrap_angle_rad(angle_3)) }
    }

    /// The attitude, for any finite angles.
    #[must_use]
    pub fn to_quaternion(&self) -> UnitQuaternion<f64> {
        let [first, second, third] = self.sequence.unit_axes();
        UnitQuaternion::from_axis_angle(&first, self.angles_rad.x)
            * UnitQuaternion::from_axis_angle(&second, self.angles_rad.y)
            * UnitQuaternion::from_axis_angle(&third, self.angles_rad.z)
    }

    /// `S(theta)` of eq. (4.5): `omega_wb_b = S(theta) theta_dot`, defined everywhere.
    #[must_use]
    pub fn rate_matrix(&self) -> Matrix3<f64> {
        let [first, second, third] = self.sequence.unit_axes();
        let undo_third = rotation(&third, -self.angles_rad.z);
        let undo_second = rotation(&second, -self.angles_rad.y);
        Matrix3::from_columns(&[
            undo_third * (undo_second * first.into_inner()),
            undo_third * second.into_inner(),
            third.into_inner(),
        ])
    }

    /// The angle rates `S(theta)^-1 omega` of eq. (4.5) \[rad/s\].
    ///
    /// # Errors
    /// [`GimbalLock`] within 1e-9 rad of a singular second angle.
    pub fn rates_rad_s(&self, omega_wb_b_rad_s: &Vector3<f64>) -> Result<Vector3<f64>, GimbalLock> {
        let (.., proper) = self.sequence.axes();
        let lock = GimbalLock { sequence: self.sequence, second_angle_rad: self.angles_rad.y };
        // det S = -+cos(a2) for three different axes, -+sin(a2) where the first repeats.
        let (sine, cosine) = self.angles_rad.y.sin_cos();
        let determinant = if proper { sine } else { cosine };
        if determinant.is_nan() || determinant.abs() <= GIMBAL_LOCK_RAD {
            return Err(lock);
        }
        self.rate_matrix().lu().solve(omega_wb_b_rad_s).ok_or(lock)
    }
}

/// +1 where the axes (first, second, remaining) are right-handed, else -1.
fn handedness(first: usize, second: usize) -> f64 {
    if (first + 1) % 3 == second { 1.0 } else { -1.0 }
}

/// Rodrigues' formula.
fn rotation(axis: &Vector3<f64>, angle_rad: f64) -> Matrix3<f64> {
    let cross = skew(axis);
    let (sine, cosine) = angle_rad.sin_cos();
    Matrix3::identity() + cross * sine + cross * cross * (1.0 - cosine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{integrate_rate, quaternion_exp};
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn sequence() -> impl Strategy<Value = EulerSequence> {
        prop::sample::select(EulerSequence::ALL.to_vec())
    }

    /// Largest element of the difference of rotation matrices: quaternion angles lose half the digits.
    fn difference(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        (a.to_rotation_matrix().matrix() - b.to_rotation_matrix().matrix()).amax()
    }

    #[test]
    fn yaw_pitch_roll_agrees_with_nalgebra() {
        let q = UnitQuaternion::from_euler_angles(0.2, -0.5, 2.5);
        let angles = EulerAngles::from_quaternion(&q, EulerSequence::E321).angles_rad;
        assert!((angles - Vector3::new(2.5, -0.5, 0.2)).norm() < 1e-14);
    }

    #[test]
    fn printed_rate_matrix_of_yaw_pitch_roll() {
        // Textbook (Stevens and Lewis, eq. 1.3-21, transposed to yaw, pitch, roll order).
        let (pitch, roll) = (0.4_f64, -0.7_f64);
        let euler = EulerAngles { sequence: EulerSequence::E321, angles_rad: Vector3::new(1.0, pitch, roll) };
        let expected = Matrix3::new(
            -pitch.sin(),
            0.0,
            1.0,
            roll.sin() * pitch.cos(),
            roll.cos(),
            0.0,
            roll.cos() * pitch.cos(),
            -roll.sin(),
            0.0,
        );
        assert!((euler.rate_matrix() - expected).amax() < 1e-15);
    }

    #[test]
    fn singular_second_angles_still_reproduce_the_attitude() {
        for sequence in EulerSequence::ALL {
            let (.., proper) = sequence.axes();
            let singular = if proper { [0.0, PI] } else { [FRAC_PI_2, -FRAC_PI_2] };
            for (second, offset) in
                singular.into_iter().flat_map(|s| [0.0, 1e-12, 1e-9, 1e-7, 1e-4].map(|offset| (s, offset)))
            {
                let angles_rad = Vector3::new(0.7, second + offset, -1.3);
                let euler = EulerAngles { sequence, angles_rad };
                let q = euler.to_quaternion();
                let back = EulerAngles::from_quaternion(&q, sequence);
                assert!(difference(&back.to_quaternion(), &q) < 2e-9, "{sequence:?} {offset}");
                if offset == 0.0 {
                    assert!(euler.rates_rad_s(&Vector3::x()).is_err(), "{sequence:?}");
                    assert_eq!(back.angles_rad.z, 0.0, "{sequence:?}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn round_trip_of_any_attitude(v in prop::array::uniform3(-3.0..3.0_f64), s in sequence()) {
            let q = quaternion_exp(&Vector3::from(v));
            let euler = EulerAngles::from_quaternion(&q, s);
            prop_assert!(difference(&euler.to_quaternion(), &q) < 1e-13);
            let (.., proper) = s.axes();
            let second = euler.angles_rad.y;
            let in_range = if proper { (0.0..=PI).contains(&second) } else { second.abs() <= FRAC_PI_2 };
            prop_assert!(in_range);
        }

        #[test]
        fn angles_return_in_their_range(
            first in -3.1..3.1_f64, second in 0.05..1.5_f64, third in -3.1..3.1_f64, s in sequence(),
        ) {
            let euler = EulerAngles { sequence: s, angles_rad: Vector3::new(first, second, third) };
            let back = EulerAngles::from_quaternion(&euler.to_quaternion(), s);
            prop_assert!((back.angles_rad - euler.angles_rad).norm() < 1e-11);
        }

        #[test]
        fn rates_are_the_derivative(
            first in -2.0..2.0_f64, second in 0.2..1.3_f64, third in -2.0..2.0_f64,
            w in prop::array::uniform3(-2.0..2.0_f64), s in sequence(),
        ) {
            let euler = EulerAngles { sequence: s, angles_rad: Vector3::new(first, second, third) };
            let (q, omega, step) = (euler.to_quaternion(), Vector3::from(w), 1e-6);
            let at = |dt| EulerAngles::from_quaternion(&integrate_rate(&q, &omega, dt), s).angles_rad;
            let numeric = (at(step) - at(-step)) / (2.0 * step);
            let rates = euler.rates_rad_s(&omega).expect("far from gimbal lock");
            prop_assert!((numeric - rates).norm() < 1e-6);
            prop_assert!((euler.rate_matrix() * rates - omega).norm() < 1e-12);
        }
    }
}
