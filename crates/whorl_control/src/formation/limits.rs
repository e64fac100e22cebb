//! What a platform's reference may do.

use nalgebra::Vector3;

/// Freedom of tilt that references may use: the bearing's stop less a margin for control error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TiltFreedom {
    /// Tabletop: the angle between body z and the vertical stays within this.
    Cone {
        /// Largest tilt \[rad\], 0 < x < pi/2.
        max_rad: f64,
    },
    /// Dumbbell: pitch stays within +- this; yaw and roll are free.
    Pitch {
        /// Largest pitch \[rad\], 0 < x < 80 deg.
        max_rad: f64,
    },
}

/// Pitch limits beyond this come too close to the singularity of yaw, pitch and roll \[rad\].
const PITCH_CEILING_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;

impl TiltFreedom {
    /// The limited angle at these yaw, pitch and roll angles \[rad\], >= 0.
    ///
    /// The set of (pitch, roll) within a cone is convex: `ln cos pitch + ln cos roll` is concave
    /// where both cosines are positive.
    #[must_use]
    pub fn angle_rad(&self, yaw_pitch_roll_rad: &Vector3<f64>) -> f64 {
        let (pitch, roll) = (yaw_pitch_roll_rad.y, yaw_pitch_roll_rad.z);
        match self {
            // cos(tilt) = cos(pitch) cos(roll), in the form that keeps its digits near zero.
            Self::Cone { .. } => pitch.sin().hypot(pitch.cos() * roll.sin()).atan2(pitch.cos() * roll.cos()),
            Self::Pitch { .. } => pitch.abs(),
        }
    }

    /// Its limit \[rad\].
    #[must_use]
    pub fn max_rad(&self) -> f64 {
        match *self {
            Self::Cone { max_rad } | Self::Pitch { max_rad } => max_rad,
        }
    }

    /// The nearest angles inside the limit (pitch and roll scaled together for a cone), and whether
    /// they differ from those given. Yaw is untouched.
    #[must_use]
    pub fn clip(&self, yaw_pitch_roll_rad: &Vector3<f64>) -> (Vector3<f64>, bool) {
        if self.angle_rad(yaw_pitch_roll_rad) <= self.max_rad() {
            return (*yaw_pitch_roll_rad, false);
        }
        let mut clipped = *yaw_pitch_roll_rad;
        match self {
            Self::Pitch { max_rad } => clipped.y = clipped.y.clamp(-max_rad, *max_rad),
            Self::Cone { max_rad } => {
                let (direction_y, direction_z) = {
                    let length = clipped.y.hypot(clipped.z);
                    (clipped.y / length, clipped.z / length)
                };
                // Tilt grows along the ray up to 90 deg, so bisection finds the crossing. It is never
                // shorter than the limit nor longer than sqrt(2) times it (equal pitch and roll).
                let (mut inside, mut outside) = (0.0, 1.5 * max_rad);
                for _ in 0..60 {
                    let middle = 0.5 * (inside + outside);
                    (clipped.y, clipped.z) = (direction_y * middle, direction_z * middle);
                    if self.angle_rad(&clipped) <= *max_rad { inside = middle } else { outside = middle }
                }
                (clipped.y, clipped.z) = (direction_y * inside, direction_z * inside);
            }
        }
        (clipped, true)
    }
}

/// Limits of a platform's reference, in yaw, pitch and roll.
///
/// Rate and acceleration bound the Euclidean norm of the three angle rates and accelerations. The
/// body rate exceeds that by at most a factor `sqrt(1 + sin(pitch))`; the body acceleration by the
/// same factor plus the coupling of two rates, below `1.5 rate_max^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceLimits {
    /// Tilt.
    pub tilt: TiltFreedom,
    /// Largest rate \[rad/s\], > 0.
    pub rate_max_rad_s: f64,
    /// Largest acceleration \[rad/s^2\], > 0.
    pub acceleration_max_rad_s2: f64,
}

/// Limits that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LimitsError {
    /// The tilt limit is outside its range.
    #[error(
        "tilt limit {max_rad} rad: it must lie above 0 and below {ceiling_rad:.3} rad",
        ceiling_rad = PITCH_CEILING_RAD
    )]
    Tilt {
        /// As given \[rad\].
        max_rad: f64,
    },
    /// Rate or acceleration is not a positive number.
    #[error("{name} is {value}: it must be a positive number")]
    NotPositive {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
    },
}

impl ReferenceLimits {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Which number is wrong and what is allowed.
    pub fn check(&self) -> Result<(), LimitsError> {
        let max_rad = self.tilt.max_rad();
        if !(max_rad > 0.0 && max_rad < PITCH_CEILING_RAD) {
            return Err(LimitsError::Tilt { max_rad });
        }
        for (name, value) in [
            ("the rate limit [rad/s]", self.rate_max_rad_s),
            ("the acceleration limit [rad/s^2]", self.acceleration_max_rad_s2),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(LimitsError::NotPositive { name, value });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formation::YawPitchRoll;
    use proptest::prelude::*;
    use whorl_math::{elevation_x_rad, tilt_rad};

    proptest! {
        #[test]
        fn angles_are_those_of_the_attitude(y in -3.0..3.0_f64, p in -1.5..1.5_f64, r in -3.0..3.0_f64) {
            let angles = Vector3::new(y, p, r);
            let q = YawPitchRoll::from_vector(angles).attitude();
            let cone = TiltFreedom::Cone { max_rad: 0.1 }.angle_rad(&angles);
            prop_assert!((cone - tilt_rad(&q)).abs() < 1e-12);
            let pitch = TiltFreedom::Pitch { max_rad: 0.1 }.angle_rad(&angles);
            prop_assert!((pitch - elevation_x_rad(&q).abs()).abs() < 1e-12);
        }

        #[test]
        fn clipping_ends_on_the_limit_and_keeps_the_direction(
            y in -3.0..3.0_f64, p in -1.5..1.5_f64, r in -3.1..3.1_f64, max in 0.01..1.2_f64,
        ) {
            let angles = Vector3::new(y, p, r);
            for tilt in [TiltFreedom::Cone { max_rad: max }, TiltFreedom::Pitch { max_rad: max }] {
                let (clipped, was_clipped) = tilt.clip(&angles);
                prop_assert!(tilt.angle_rad(&clipped) <= max);
                prop_assert_eq!(was_clipped, tilt.angle_rad(&angles) > max);
                prop_assert_eq!(clipped.x, y);
                if was_clipped {
                    prop_assert!(tilt.angle_rad(&clipped) > max - 1e-9);
                    if matches!(tilt, TiltFreedom::Cone { .. }) {
                        prop_assert!((clipped.y * r - clipped.z * p).abs() < 1e-9);
                        prop_assert!(clipped.y * p >= 0.0 && clipped.z * r >= 0.0);
                    }
                } else {
                    prop_assert_eq!(clipped, angles);
                }
            }
        }
    }

    #[test]
    fn impossible_limits_are_refused_in_words() {
        let good = ReferenceLimits {
            tilt: TiltFreedom::Cone { max_rad: 0.08 },
            rate_max_rad_s: 0.05,
            acceleration_max_rad_s2: 0.01,
        };
        assert!(good.check().is_ok());
        let tilted = ReferenceLimits { tilt: TiltFreedom::Pitch { max_rad: 1.5 }, ..good };
        assert!(tilted.check().unwrap_err().to_string().contains("below 1.396 rad"));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(ReferenceLimits { rate_max_rad_s: bad, ..good }.check().is_err());
            assert!(ReferenceLimits { acceleration_max_rad_s2: bad, ..good }.check().is_err());
        }
    }
}
