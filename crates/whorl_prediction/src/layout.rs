//! Where each part of the estimated state stands.

use std::ops::Range;

use whorl_dynamics::plant::Tangent;

/// Coordinates of an estimate's error: those of the plant ([`Tangent`]), then the disturbance torque [N m], the biases of
/// gyro [rad/s] and accelerometer [m/s^2], as far as there are any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Of the plant.
    pub plant: Tangent,
    disturbance: bool,
    gyro_bias: bool,
    force_bias: bool,
}

impl Layout {
    pub(crate) fn new(plant: Tangent, disturbance: bool, gyro_bias: bool, force_bias: bool) -> Self {
        Self { plant, disturbance, gyro_bias, force_bias }
    }

    /// The disturbance torque.
    #[must_use]
    pub fn disturbance(&self) -> Range<usize> {
        after(self.plant.size(), self.disturbance)
    }

    /// Bias of the gyro.
    #[must_use]
    pub fn gyro_bias(&self) -> Range<usize> {
        after(self.disturbance().end, self.gyro_bias)
    }

    /// Bias of the accelerometer.
    #[must_use]
    pub fn force_bias(&self) -> Range<usize> {
        after(self.gyro_bias().end, self.force_bias)
    }

    /// What moves: the plant and the disturbance. The rest stays as it is, or walks.
    #[must_use]
    pub fn moving(&self) -> usize {
        self.disturbance().end
    }

    /// How many coordinates there are.
    #[must_use]
    pub fn size(&self) -> usize {
        self.force_bias().end
    }
}

fn after(start: usize, there: bool) -> Range<usize> {
    start..start + if there { 3 } else { 0 }
}
