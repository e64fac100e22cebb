//! Is there iron or a magnet on the sensor?

use super::{FreeMotionEstimate, FreeMotionFilter, FreeMotionParameters};
use nalgebra::{Matrix6, Vector3};

/// Field of a magnet on the sensor, relative to the field's length \[1\].
const MAGNET_SIGMA: f64 = 0.3;

/// So much more likely must a magnet be before it is believed (difference of log-likelihoods). Successive samples are
/// correlated, so this is far above what independent ones would need.
const EVIDENCE: f64 = 1000.0;

/// Two filters on the same samples: one for a clean sensor, one for a sensor with iron or a magnet on it. The second
/// speaks once the magnetometer's samples are clearly likelier under it.
///
/// A clean sensor must not doubt its field (the heading at the start would be lost); one with a magnet must. Which it is
/// shows as soon as the sensor turns: a magnet turns with it, the world's field does not.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeMotionEstimator {
    clean: FreeMotionFilter,
    magnetised: FreeMotionFilter,
    /// Whether the magnet was believed at the latest sample.
    believed: bool,
}

impl FreeMotionEstimator {
    /// An estimator that finds its first attitude from its first samples.
    #[must_use]
    pub fn new(parameters: FreeMotionParameters) -> Self {
        let magnetised = FreeMotionParameters { iron_sigma: MAGNET_SIGMA, ..parameters };
        Self {
            clean: FreeMotionFilter::new(parameters),
            magnetised: FreeMotionFilter::new(magnetised),
            believed: false,
        }
    }

    /// As [`FreeMotionFilter::on_imu`].
    pub fn on_imu(&mut self, stamp_ns: i64, gyro_rad_s: &Vector3<f64>, force_m_s2: &Vector3<f64>) {
        self.clean.on_imu(stamp_ns, gyro_rad_s, force_m_s2);
        self.magnetised.on_imu(stamp_ns, gyro_rad_s, force_m_s2);
    }

    /// As [`FreeMotionFilter::on_magnetometer`].
    pub fn on_magnetometer(&mut self, field: &Vector3<f64>) {
        self.clean.on_magnetometer(field);
        self.magnetised.on_magnetometer(field);
        if !self.believed && self.is_magnetised() {
            // What it took the heading for while it did not yet know the magnet is worth nothing.
            self.magnetised.forget_heading();
        }
        self.believed = self.is_magnetised();
    }

    /// Whether a magnet on the sensor is believed.
    #[must_use]
    pub fn is_magnetised(&self) -> bool {
        self.magnetised.log_likelihood() > self.clean.log_likelihood() + EVIDENCE
    }

    /// Covariance of the attitude error (body axes \[rad\]) and the gyro's bias error [rad/s].
    #[must_use]
    pub fn covariance(&self) -> Matrix6<f64> {
        if self.is_magnetised() { self.magnetised.covariance() } else { self.clean.covariance() }
    }

    /// The estimate; `None` before the first attitude.
    #[must_use]
    pub fn estimate(&self) -> Option<FreeMotionEstimate> {
        if self.is_magnetised() { self.magnetised.estimate() } else { self.clean.estimate() }
    }
}
