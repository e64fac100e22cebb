//! Where each part of the estimated state stands.

use std::ops::Range;

use nalgebra::DMatrix;
use whorl_dynamics::plant::Tangent;
use whorl_dynamics::platform::SensorSuite;

/// Coordinates of an estimate's error: those of the plant ([`Tangent`]), then the disturbance torque on the body
/// and that of each motor [N m], the biases of gyro [rad/s] and accelerometer [m/s^2], as far as there are any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Of the plant.
    pub plant: Tangent,
    disturbance: usize,
    motors: usize,
    gyro_bias: usize,
    force_bias: usize,
}

impl Layout {
    /// With so many random torques on the body, of so many motors, and the biases of the two sensors.
    pub(crate) fn new(
        plant: Tangent,
        disturbances: usize,
        motors: usize,
        gyro_bias: bool,
        force_bias: bool,
    ) -> Self {
        let three = |there| if there { 3 } else { 0 };
        Self {
            plant,
            disturbance: 3 * disturbances,
            motors,
            gyro_bias: three(gyro_bias),
            force_bias: three(force_bias),
        }
    }

    /// The disturbance torques on the body, about three axes each.
    #[must_use]
    pub fn disturbance(&self) -> Range<usize> {
        after(self.plant.size(), self.disturbance)
    }

    /// The disturbance torque of each motor.
    #[must_use]
    pub fn motors(&self) -> Range<usize> {
        after(self.disturbance().end, self.motors)
    }

    /// Bias of the gyro.
    #[must_use]
    pub fn gyro_bias(&self) -> Range<usize> {
        after(self.motors().end, self.gyro_bias)
    }

    /// Bias of the accelerometer.
    #[must_use]
    pub fn force_bias(&self) -> Range<usize> {
        after(self.gyro_bias().end, self.force_bias)
    }

    /// What moves: the plant and its disturbances. The rest stays as it is, or walks.
    #[must_use]
    pub fn moving(&self) -> usize {
        self.motors().end
    }

    /// Variance that a coordinate gains in a second by its own random walk.
    pub(crate) fn walk_variance(&self, sensors: &SensorSuite, hidden_noise: &[f64], i: usize) -> f64 {
        let of = |walk: Option<&f64>| walk.copied().unwrap_or(0.0).powi(2);
        let within = |all: Range<usize>| all.contains(&i).then(|| i - all.start);
        if let Some(k) = within(self.plant.hidden()) {
            return of(hidden_noise.get(k));
        }
        if let Some(k) = within(self.gyro_bias()) {
            return of(sensors.gyro.errors.bias_walk.get(k));
        }
        if let Some(k) = within(self.force_bias()) {
            return of(sensors.accelerometer.errors.bias_walk.get(k));
        }
        0.0
    }

    /// The part of a covariance that is not of disturbances: plant and biases.
    pub(crate) fn without_disturbance(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let kept: Vec<usize> = (0..self.plant.size()).chain(self.moving()..self.size()).collect();
        covariance.select_rows(&kept).select_columns(&kept)
    }

    /// How many coordinates there are.
    #[must_use]
    pub fn size(&self) -> usize {
        self.force_bias().end
    }
}

fn after(start: usize, count: usize) -> Range<usize> {
    start..start + count
}
