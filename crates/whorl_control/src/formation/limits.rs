//! Limits of a platform's reference.

use crate::reference::TiltEnvelope;

/// Tilt limits at or beyond this come too close to the singularity of yaw, pitch and roll \[rad\].
const TILT_CEILING_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;

/// Limits of a platform's reference, in yaw, pitch and roll.
///
/// Rate and acceleration bound the Euclidean norm of the three angle rates and accelerations. The
/// body rate exceeds that by at most a factor `sqrt(1 + sin(pitch))`; the body acceleration by the
/// same factor plus the coupling of two rates, below `1.5 rate_max^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceLimits {
    /// Tilt: the bearing's freedom less a margin.
    pub envelope: TiltEnvelope,
    /// Largest rate \[rad/s\], > 0.
    pub rate_max_rad_s: f64,
    /// Largest acceleration \[rad/s^2\], > 0.
    pub acceleration_max_rad_s2: f64,
}

/// Invalid limits.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LimitsError {
    /// The tilt limit is too large for references in yaw, pitch and roll.
    #[error(
        "the tilt limit less its margin is {max_rad} rad: references allow less than {TILT_CEILING_RAD:.3} rad"
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
        let max_rad = self.envelope.max_rad();
        if max_rad >= TILT_CEILING_RAD {
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
    use whorl_dynamics::platform::TiltLimit;

    #[test]
    fn impossible_limits_are_refused_in_words() {
        let envelope = |limit| TiltEnvelope::new(limit, 0.0).unwrap();
        let good = ReferenceLimits {
            envelope: envelope(TiltLimit::Cone { max_rad: 0.08 }),
            rate_max_rad_s: 0.05,
            acceleration_max_rad_s2: 0.01,
        };
        assert!(good.check().is_ok());
        let steep = ReferenceLimits { envelope: envelope(TiltLimit::Pitch { max_rad: 1.5 }), ..good };
        assert!(steep.check().unwrap_err().to_string().contains("less than 1.396 rad"));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(ReferenceLimits { rate_max_rad_s: bad, ..good }.check().is_err());
            assert!(ReferenceLimits { acceleration_max_rad_s2: bad, ..good }.check().is_err());
        }
    }
}
