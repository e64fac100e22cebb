//! Single channels.

use crate::platform::{ScalarSensor, WheelSpeedSensor};

/// `x` rounded to the nearest multiple of `quantum`; unchanged for no quantum.
pub(super) fn quantised(x: f64, quantum: f64) -> f64 {
    if quantum > 0.0 { (x / quantum).round() * quantum } else { x }
}

impl ScalarSensor {
    /// What the channel reads, in its own unit.
    #[must_use]
    pub fn reading(&self, truth: f64, standard_normal: f64) -> f64 {
        quantised(truth + self.noise_stddev * standard_normal, self.quantum)
    }

    /// Standard deviation of a reading about the truth, in its own unit: noise, and rounding to steps.
    #[must_use]
    pub fn stddev(&self) -> f64 {
        self.noise_stddev.hypot(self.quantum / 12f64.sqrt())
    }
}

impl WheelSpeedSensor {
    /// What the tachometer reads [rad/s].
    #[must_use]
    pub fn reading_rad_s(&self, truth_rad_s: f64, standard_normal: f64) -> f64 {
        quantised(truth_rad_s + self.noise_stddev_rad_s * standard_normal, self.quantum_rad_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_to_the_nearest_step() {
        assert_eq!(quantised(0.26, 0.25), 0.25);
        assert_eq!(quantised(-0.38, 0.25), -0.5);
        assert_eq!(quantised(0.26, 0.0), 0.26);
    }
}
